"""Up direction and room heading from straight edges: verticals and two level directions at right angles."""

import math

import numpy as np

from edgemap.geometry.arrays import Array
from edgemap.geometry.camera.attitude import RoomAxes
from edgemap.geometry.camera.inertial import SKEW, small_rotation
from edgemap.geometry.robust import tukey

STEP_RAD, COARSE_RAD = math.radians(2.0), math.radians(2.5)  # between directions tried, and how near edges count then
NEAR_RAD = math.radians(1.5)  # an edge belongs to a direction that its plane misses by less, at last
SIGMA_RAD = math.radians(0.7)  # of an edge of REFERENCE_RAD; shorter ones are less certain
REFERENCE_RAD = 0.15
FEWEST, MINIMUM_LENGTH_RAD = 6, 0.6  # upright edges, and their length as seen
MINIMUM_SHARE = 0.4  # of all edges' length that the three directions explain
LEVEL_LENGTH_RAD = 1.5  # of level edges that show the room's direction; fewer may be those of one piece of furniture
# Of that direction by the edges of many pictures (up by one picture: median error 0.3 degrees in rendered homes, 0.8 in
# two real rooms, 1.7 in a kitchen, 1.2 on a street; one in ten is off by 3 degrees and more); and of it, times the
# square of its edges' length: 3 degrees with 1.5 rad, 0.5 with 7 (homes 8301-8310).
DIRECTION_SIGMA_RAD, LEVEL_SIGMA_RAD3 = math.radians(0.4), math.radians(6.0)


def room_axes(normals: Array, lengths: Array, expected: Array, reach_rad: float) -> RoomAxes | None:
    """A room's axes from its edges, up near an expected direction; None where too few edges agree.

    normals: (N, 3) of the planes through lens and edge, optical frame. lengths: (N,) rad. The best of a grid by the
    length of upright edges, then all three directions of the room together by robust least squares (a Manhattan world:
    Coughlan and Yuille 1999).
    """
    if len(lengths) < FEWEST:
        return None
    up = most_upright(normals, lengths, expected, reach_rad)
    (right, away), heading = level_axes(up), room_heading(normals, lengths, up)
    first = math.cos(heading) * right + math.sin(heading) * away
    directions = np.stack([up, first, np.cross(up, first)])
    each, explained = np.arange(len(lengths)), 0.0
    upright = level = lengths > 0.0
    weight = np.minimum(lengths / REFERENCE_RAD, 2.0) / SIGMA_RAD**2
    for _ in range(5):  # from the best of a grid, which needs no annealing
        misses = normals @ directions.T
        kind = np.abs(misses).argmin(axis=1)
        miss = misses[each, kind]
        share = tukey((miss / SIGMA_RAD) ** 2)
        slopes = (normals @ (directions @ SKEW).reshape(3, 3, 3).transpose(0, 2, 1))[kind, each]  # their cross products
        weighted = slopes * (weight * share)[:, None]
        step = -np.linalg.solve(weighted.T @ slopes + np.eye(3), weighted.T @ miss)
        directions = directions @ small_rotation(*step.tolist()).T
        near = np.abs(miss) < NEAR_RAD
        upright, level = near & (kind == 0), near & (kind > 0)
        explained = float(lengths[near].sum() / lengths.sum())
    seen_rad = float(lengths[upright].sum())
    if upright.sum() < FEWEST or seen_rad <= MINIMUM_LENGTH_RAD or explained <= MINIMUM_SHARE:
        return None
    right, away = level_axes(directions[0])
    level_rad = math.atan2(-float(directions[1] @ right), float(directions[1] @ away))
    seen_rad = max(float(lengths[level].sum()), 1e-3)
    sigma_rad = DIRECTION_SIGMA_RAD + LEVEL_SIGMA_RAD3 / seen_rad**2
    return RoomAxes(level_rad if seen_rad > LEVEL_LENGTH_RAD else None, sigma_rad, directions[0])


def most_upright(normals: Array, lengths: Array, expected: Array, reach_rad: float) -> Array:
    """Of the directions about the expected one, the one whose planes hold the greatest total length of edges."""
    steps = math.ceil(reach_rad / STEP_RAD)
    offsets = np.arange(-steps, steps + 1) * STEP_RAD
    right, away = level_axes(expected)
    a, b = (values.ravel() for values in np.meshgrid(offsets, offsets))
    tried = expected + a[:, None] * right + b[:, None] * away
    tried /= np.linalg.norm(tried, axis=1, keepdims=True)
    near = normals @ (tried.T / COARSE_RAD)
    near *= near
    np.maximum(np.subtract(1.0, near, out=near), 0.0, out=near)
    support = lengths @ near
    likely = np.exp(-1.5 * (a**2 + b**2) / reach_rad**2)
    return tried[int((support * likely).argmax())]


def room_heading(normals: Array, lengths: Array, up: Array) -> float:
    """The angle at which most edges are level along a wall, rad, modulo a right angle, from the first of `level_axes`
    towards the second. normals, lengths: as of `room_axes`."""
    right, away = level_axes(up)
    level = np.cross(normals, up)  # and in the edge's plane
    size = np.linalg.norm(level, axis=1)
    angles = np.arctan2(level @ away, level @ right)
    # Near the horizon any heading will do, and an upright edge has none.
    clear = (size > math.sin(math.radians(10.0))) & (np.abs(normals @ up) > math.sin(NEAR_RAD))
    tried = np.linspace(0.0, math.pi / 2.0, 90, endpoint=False)
    off = np.abs(angles % (math.pi / 2.0) - tried[:, None])
    off = np.minimum(off, math.pi / 2.0 - off)
    votes = np.exp(-0.5 * (off / NEAR_RAD) ** 2) @ (lengths * clear)
    return float(tried[votes.argmax()])


def level_axes(up: Array) -> tuple[Array, Array]:
    """Two level directions at right angles, optical frame: to the right in the picture, and away from the lens."""
    x, y, z = up.tolist()
    size = max(math.hypot(x, y), 1e-9)
    return np.array([-y, x, 0.0]) / size, np.array([-z * x, -z * y, 1.0 - z * z]) / size
