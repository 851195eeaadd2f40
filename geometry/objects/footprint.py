"""Rectangle of an object on the floor, fitted to the outlines of its boxes.

The sides and the lower edge of a box are lines that touch the footprint. At a fixed yaw the distance of each line from
the origin is linear in the rectangle's centre and half sides, so every yaw is one linear least squares problem.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from edgemap.geometry.arrays import Array
from edgemap.geometry.grid.occupancy_grid import FREE, OccupancyGrid
from edgemap.geometry.grid.walls import walls_of
from edgemap.geometry.map_object import ObjectFootprint
from edgemap.geometry.observations.class_extents import footprint_m
from edgemap.geometry.se2 import wrap_angle

YAWS = 36  # of half a turn that are tried
HUBER2 = 4.0  # squared normalised residual from which on a line counts less (Cauchy)
SQUARE = 0.15  # difference of sides up to which a quarter turn makes none
DIRECTIONS = 24  # of view; the lines seen along one repeat each other's error
SAMPLES = np.stack(np.meshgrid(*[np.linspace(-0.9, 0.9, 10)] * 2), axis=-1).reshape(-1, 2)  # of the half sides
NEAR_RAD = math.radians(12.0)  # of the most probable yaw: averaged


@dataclass(frozen=True, slots=True)
class FootprintRule:
    """Errors of what a footprint is fitted to, by calibration on rendered tuning homes."""

    # Standard deviations of a line by which side of the true one it lies on: boxes are cut short by what stands before
    # the object and legs stand back from a top, but hardly a box is too large.
    side_m: float = 0.03
    side_inside_m: float = 0.10
    foot_m: float = 0.06
    foot_inside_m: float = 0.30
    margin_m: float = 0.025  # by which a line lies inside of the bounding rectangle on the mean: corners are not filled
    size_share: float = 0.2  # standard deviation of a side, of the class's usual one
    centre_share: float = 0.08  # of the position, of the class's longer side
    aligned: float = 20.0  # odds of a yaw along the walls nearby to any other
    free: float = 6.0  # log-odds against a rectangle that holds nothing but free floor
    unknown_rad: float = 0.6  # standard deviation of a yaw from which on it is unknown


@dataclass(frozen=True, slots=True, eq=False)
class FittedFootprint:
    """A footprint, and its centre (2,) from the position that it was fitted about."""

    shape: ObjectFootprint
    offset_m: Array


def fitted(
    label: str,
    width_m: float,
    position_m: Array,
    outlines: Array,
    grid: OccupancyGrid | None,
    rule: FootprintRule,
    saved: ObjectFootprint | None = None,
) -> FittedFootprint | None:
    """The footprint about a position (2,) by outlines (N, 3, 2): lens and both ends of a box's lower edge, map frame;
    by the walls and the free floor of a grid, and by the footprint in an earlier map. None without outlines.
    """
    if not len(outlines):
        return None
    wide, deep = (saved.width_m, saved.depth_m) if saved else footprint_m(label, width_m)
    towards = np.mean(outlines[:, 0], axis=0) - position_m
    seen_rad = math.atan2(towards[1], towards[0])  # a map that is turned gets the same footprints
    yaws: Array = seen_rad + np.linspace(0.0, math.pi, YAWS, endpoint=False, dtype=np.float64)
    front = np.column_stack([np.cos(yaws), np.sin(yaws)])
    across = np.column_stack([-front[:, 1], front[:, 0]])
    rectangles, cost = _rectangles(np.array([*position_m, deep / 2.0, wide / 2.0]), outlines, front, across, rule)
    fit = -cost / 2.0
    if grid is not None:
        fit += _along_walls(yaws, position_m, grid, rule)
        inside_m = rectangles[:, None, :2] + (SAMPLES * rectangles[:, None, 2:]) @ np.stack([front, across], axis=1)
        fit -= rule.free * (grid.at(inside_m).reshape(YAWS, -1) == FREE).mean(axis=1)
    if saved is not None and saved.yaw_rad is not None:
        off = (yaws - saved.yaw_rad + math.pi / 2.0) % math.pi - math.pi / 2.0
        fit -= 0.5 * (off / max(saved.yaw_sigma_rad, NEAR_RAD)) ** 2
    likely = np.exp(fit - fit.max())
    likely /= likely.sum()
    best = int(likely.argmax())
    off = (yaws - yaws[best] + math.pi / 2.0) % math.pi - math.pi / 2.0
    near = np.where(np.abs(off) <= NEAR_RAD, likely, 0.0) / likely[np.abs(off) <= NEAR_RAD].sum()
    x_m, y_m, half_deep, half_wide = (near @ rectangles).tolist()
    longer = yaws + np.where(rectangles[:, 3] > rectangles[:, 2], math.pi / 2.0, 0.0)  # one rectangle has two fronts
    square = abs(half_wide - half_deep) < SQUARE * max(half_wide, half_deep)
    turn = math.pi / 2.0 if square else math.pi
    sigma = math.sqrt(float(likely @ ((longer - longer[best] + turn / 2.0) % turn - turn / 2.0) ** 2))
    shape = ObjectFootprint(2.0 * half_wide, 2.0 * half_deep)
    if sigma <= rule.unknown_rad:
        yaw = float(yaws[best] + near @ off)
        yaw += 0.0 if math.cos(yaw - seen_rad) >= 0.0 else math.pi  # its front is the side that it was seen from
        shape = replace(shape, yaw_rad=wrap_angle(yaw), yaw_sigma_rad=sigma)
    return FittedFootprint(shape, np.array([x_m, y_m]) - position_m)


def _rectangles(prior: Array, outlines: Array, front: Array, across: Array, rule: FootprintRule) -> tuple[Array, Array]:
    """Centre, half depth and half width of the best rectangle (Y, 4) for each direction of its front (Y, 2), and twice
    its negative log-likelihood (Y,); robust and asymmetric least squares about a prior (4,)."""
    normals, offsets, sigmas_m, weights = _lines(outlines, front[0], rule)
    sizes = np.concatenate([np.full(2, rule.centre_share * 2.0 * prior[2:].max()), rule.size_share * prior[2:]])
    by_size = np.abs(np.stack([front @ normals.T, across @ normals.T], axis=-1))
    design = np.concatenate([np.broadcast_to(normals, (len(front), *normals.shape)), by_size], axis=2)
    rectangles: Array = np.tile(prior, (len(front), 1))
    for _ in range(5):  # of reweighting, which has converged by then
        scale_m, chi2 = _residuals(design, rectangles, offsets, sigmas_m)
        weighted = design.transpose(0, 2, 1) * (weights / scale_m**2 / (1.0 + chi2 / HUBER2))[:, None]
        normal = weighted @ design + np.diag(sizes**-2)
        right = weighted @ offsets + prior / sizes**2
        rectangles = np.linalg.solve(normal, right[:, :, None])[:, :, 0].astype(np.float64)
    _, chi2 = _residuals(design, rectangles, offsets, sigmas_m)
    cost = (weights * HUBER2 * np.log1p(chi2 / HUBER2)).sum(axis=1)
    return rectangles, cost + (((rectangles - prior) / sizes) ** 2).sum(axis=1)


def _residuals(design: Array, rectangles: Array, offsets: Array, sigmas_m: Array) -> tuple[Array, Array]:
    """Standard deviations by side of each line and squared normalised residuals, (Y, N)."""
    residuals_m = offsets - (design @ rectangles[:, :, None])[:, :, 0]
    scale_m = np.where(residuals_m < 0.0, sigmas_m[1], sigmas_m[0])
    return scale_m, (residuals_m / scale_m) ** 2


def _lines(outlines: Array, front: Array, rule: FootprintRule) -> tuple[Array, Array, Array, Array]:
    """The lines of N outlines (N, 3, 2): outward normals (3 N, 2), distances from the origin (3 N,), standard
    deviations outside and inside (2, 3 N), weights (3 N,). front (2,): where directions of view are counted from."""
    lens, left, right = outlines.transpose(1, 0, 2)
    sides = np.stack([left - lens, lens - right, left - right])
    normals = np.stack([-sides[..., 1], sides[..., 0]], axis=-1) / np.linalg.norm(sides, axis=-1, keepdims=True)
    offsets = (normals * np.stack([lens, lens, left])).sum(axis=-1) + rule.margin_m
    away_m = 0.01 * np.linalg.norm((left + right) / 2.0 - lens, axis=-1)
    outside_m, inside_m = (rule.side_m, rule.side_m, rule.foot_m), (*[rule.side_inside_m] * 2, rule.foot_inside_m)
    sigmas_m = np.array([outside_m, inside_m])
    turned = np.arctan2(normals[2, :, 1], normals[2, :, 0]) - math.atan2(front[1], front[0])
    seen = np.floor(turned % math.tau * DIRECTIONS / math.tau).astype(np.intp)
    weights: Array = np.bincount(seen)[seen].astype(np.float64) ** -0.5
    return (
        normals.reshape(-1, 2), offsets.ravel(), (sigmas_m[:, :, None] + away_m).reshape(2, -1), np.tile(weights, 3)
    )  # fmt: skip


def _along_walls(yaws: Array, position_m: Array, grid: OccupancyGrid, rule: FootprintRule) -> Array:
    """Log-odds (Y,) of yaws by the walls: furniture stands along them; near and long ones count more."""
    if not (walls := walls_of(grid)):
        return np.zeros(len(yaws))
    start, end = (np.array([getattr(wall, name) for wall in walls]) for name in ("from_m", "to_m"))
    length_m = np.linalg.norm(end - start, axis=1)
    along = (end - start) / length_m[:, None]
    nearest_m = start + np.clip(((position_m - start) * along).sum(axis=1), 0.0, length_m)[:, None] * along
    weight = length_m * np.exp(-np.linalg.norm(position_m - nearest_m, axis=1))
    off = yaws - np.arctan2(along[:, 1], along[:, 0])[:, None]
    aligned = (weight[:, None] * np.exp(16.0 * (np.cos(4.0 * off) - 1.0))).sum(axis=0) / weight.sum()
    return np.log(1.0 / rule.aligned + aligned)
