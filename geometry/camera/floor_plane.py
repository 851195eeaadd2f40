"""The floor as a plane fitted to the 3-D points of a depth camera."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from edgemap.geometry.arrays import Array
from edgemap.geometry.robust import NORMAL

STEEPEST_RAD = math.radians(45.0)  # between a plane's normal and where up is expected
MINIMUM_SHARE = 0.05  # of the points, on one plane
MINIMUM_POINTS = 100
BELOW_SHARE = 0.02  # of the points, that noise and reflections put below a floor
NOISE_M, NOISE_PER_M = 0.01, 0.005  # of a point's height over the floor: constant, and with its depth
BAND = 2.5  # standard deviations about a plane that count as on it
FOLLOW_BANDS = ((0.05, 0.06), (0.03, 0.03), *[(0.0, 0.0)] * 4)  # m and rad about the expected plane, added to noise
CORRELATED = 30.0  # neighbouring depths err together: so many points count as one
SURE_RAD, SURE_M = math.radians(0.4), 0.02  # a less certain plane is not returned
QUIETEST = 0.15  # of that noise, when the points of the plane scatter less: else what stands on the floor lifts it


@dataclass(frozen=True, slots=True, eq=False)
class FloorPlane:
    """up: (3,) unit vector away from the floor, optical frame. height_m: of the lens above it. rms_m: root mean square
    distance of its points from it. share: fraction of all points that lie on it. covariance: (3, 3) in pitch, roll
    (rad) and height (m).
    """

    up: Array
    height_m: float
    rms_m: float
    share: float
    covariance: Array


def follow_floor(points_m: Array, up: Array, height_m: float) -> FloorPlane | None:
    """The floor near where it is expected, with its covariance; None where too few points lie there, or too many below.

    points_m: (N, 3), optical frame. up: (3,) unit vector and height_m of the expected plane, good to a few degrees and
    centimetres.
    """
    noise = NOISE_M + NOISE_PER_M * points_m[:, 2]
    plane = _fitted(points_m, noise, up, height_m, FOLLOW_BANDS, len(points_m))
    if plane is None or plane.height_m <= 0.0:
        return None
    variances, heights = np.diag(plane.covariance), points_m @ plane.up + plane.height_m
    sure = variances[:2].max() <= SURE_RAD**2 and variances[2] <= SURE_M**2
    return plane if sure and (heights < -2.0 * BAND * noise).mean() <= BELOW_SHARE else None


def find_floor(points_m: Array, rng: np.random.Generator, up: Array | None = None) -> FloorPlane | None:
    """The lowest large plane below the lens, none of whose points lie below it; None where there is none.

    points_m: (N, 3), optical frame. up: (3,) approximate direction, for example from gravity; by default the picture's
    upward direction. RANSAC (Fischler and Bolles 1981) for one plane after the other, each refined by least squares.
    """
    expected = np.array([0.0, -1.0, 0.0]) if up is None else up / np.linalg.norm(up)
    noise = NOISE_M + NOISE_PER_M * points_m[:, 2]
    left, planes = np.ones(len(points_m), dtype=bool), list[FloorPlane]()
    for _ in range(4):  # floor, table, seat, ceiling: the floor is the lowest of the first few
        plane = _largest(points_m[left], noise[left], expected, rng, len(points_m))
        if plane is None:
            break
        heights = points_m @ plane.up + plane.height_m
        if (heights < -2.0 * BAND * noise).mean() < BELOW_SHARE and plane.height_m > 0.0:
            planes.append(plane)
        left &= np.abs(heights) > 2.0 * BAND * noise
    return max(planes, key=lambda plane: plane.height_m, default=None)


def _largest(points: Array, noise: Array, expected: Array, rng: np.random.Generator, total: int) -> FloorPlane | None:
    """The largest plane that is nearly upright to the expected direction; None where it holds too few of `total`
    points."""
    if len(points) < MINIMUM_POINTS:
        return None
    corners = points[rng.integers(0, len(points), (300, 3))]  # of planes that are tried
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    size = np.linalg.norm(normals, axis=1)
    normals = normals / np.maximum(size, 1e-12)[:, None]
    normals *= np.where(normals @ expected < 0.0, -1.0, 1.0)[:, None]
    upright = (normals @ expected > math.cos(STEEPEST_RAD)) & (size > 1e-4)
    if not upright.any():
        return None
    normals, corners = normals[upright], corners[upright]
    heights = -(normals * corners[:, 0]).sum(axis=1)
    best = int((np.abs(points @ normals.T + heights) < BAND * noise[:, None]).sum(axis=0).argmax())
    plane = _fitted(points, noise, normals[best], float(heights[best]), [(0.0, 0.0)] * 6, total)
    return plane if plane is not None and plane.up @ expected > math.cos(STEEPEST_RAD) else None


def _fitted(
    points: Array, noise: Array, up: Array, height_m: float, bands: Sequence[tuple[float, float]], total: int
) -> FloorPlane | None:
    """The plane near an expected one by least squares, with its points chosen again in each band; None where they are
    too few of `total` points."""
    reach_m = np.linalg.norm(points, axis=1)
    covariance, on, quiet = np.eye(3), np.zeros(len(points), dtype=bool), 1.0
    for constant_m, per_m in bands:
        off = np.abs(points @ up + height_m)
        on = off < quiet * BAND * noise + constant_m + per_m * reach_m
        if on.sum() < max(MINIMUM_POINTS, MINIMUM_SHARE * total):
            return None
        if constant_m == 0.0:
            quiet = float(np.clip(NORMAL * np.median(off[on] / noise[on]), QUIETEST, 1.0))
        forward = np.array([0.0, 0.0, 1.0]) - up[2] * up
        forward /= np.linalg.norm(forward)
        side = np.cross(up, forward)
        slopes = np.column_stack([points[on] @ forward, points[on] @ side, np.ones(on.sum())])
        weighted = slopes / noise[on, None] ** 2
        covariance = np.asarray(np.linalg.pinv(weighted.T @ slopes), dtype=np.float64)
        pitch, roll, rise_m = -covariance @ weighted.T @ (points[on] @ up + height_m)
        up = up + pitch * forward + roll * side
        up, height_m = up / np.linalg.norm(up), height_m + float(rise_m)
    rms_m = float(np.sqrt(((points[on] @ up + height_m) ** 2).mean()))
    return FloorPlane(up, height_m, rms_m, float(on.sum() / total), covariance * CORRELATED * quiet**2)
