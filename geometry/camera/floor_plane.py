"""The floor as a plane fitted to the 3-D points of a depth camera."""

import math
from dataclasses import dataclass, field

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
    (rad) and height (m); infinite where it was not estimated.
    """

    up: Array
    height_m: float
    rms_m: float
    share: float
    covariance: Array = field(default_factory=lambda: np.full((3, 3), np.inf))


def follow_floor(points_m: Array, up: Array, height_m: float) -> FloorPlane | None:
    """The floor near where it is expected, with its covariance; None where too few points lie there, or too many below.

    points_m: (N, 3), optical frame. up: (3,) unit vector and height_m of the expected plane, good to a few degrees and
    centimetres. Least squares, the band about the plane ever narrower.
    """
    reach_m = np.linalg.norm(points_m, axis=1)
    noise = NOISE_M + NOISE_PER_M * points_m[:, 2]
    covariance, on, quiet = np.eye(3), np.zeros(len(points_m), dtype=bool), 1.0
    for constant_m, per_m in FOLLOW_BANDS:
        off = np.abs(points_m @ up + height_m)
        on = off < quiet * BAND * noise + constant_m + per_m * reach_m
        if on.sum() < max(MINIMUM_POINTS, MINIMUM_SHARE * len(points_m)):
            return None
        if constant_m == 0.0:
            quiet = float(np.clip(NORMAL * np.median(off[on] / noise[on]), QUIETEST, 1.0))
        forward = np.array([0.0, 0.0, 1.0]) - up[2] * up
        forward /= np.linalg.norm(forward)
        side = np.cross(up, forward)
        slopes = np.column_stack([points_m[on] @ forward, points_m[on] @ side, np.ones(on.sum())])
        weighted = slopes / noise[on, None] ** 2
        covariance = np.asarray(np.linalg.pinv(weighted.T @ slopes), dtype=np.float64)
        pitch, roll, rise_m = -covariance @ weighted.T @ (points_m[on] @ up + height_m)
        up = up + pitch * forward + roll * side
        up, height_m = up / np.linalg.norm(up), height_m + float(rise_m)
    heights = points_m @ up + height_m
    if (heights < -2.0 * BAND * noise).mean() > BELOW_SHARE or height_m <= 0.0:
        return None
    covariance = covariance * CORRELATED * quiet**2
    if np.diag(covariance)[:2].max() > SURE_RAD**2 or covariance[2, 2] > SURE_M**2:
        return None
    return FloorPlane(up, height_m, float(np.sqrt((heights[on] ** 2).mean())), float(on.mean()), covariance)


def find_floor(points_m: Array, rng: np.random.Generator, up: Array | None = None) -> FloorPlane | None:
    """The lowest large plane below the lens, none of whose points lie below it; None where there is none.

    points_m: (N, 3), optical frame. up: (3,) approximate direction, for example from gravity; by default the picture's
    upward direction. RANSAC (Fischler and Bolles 1981) for one plane after the other, each refined by least squares.
    """
    expected = np.array([0.0, -1.0, 0.0]) if up is None else up / np.linalg.norm(up)
    band = BAND * (NOISE_M + NOISE_PER_M * points_m[:, 2])
    left, planes = np.ones(len(points_m), dtype=bool), []
    for _ in range(4):  # floor, table, seat, ceiling: the floor is the lowest of the first few
        plane = _plane(points_m[left], band[left], expected, rng, len(points_m))
        if plane is None:
            break
        normal, height_m, quiet = plane
        heights = points_m @ normal + height_m
        on = left & (np.abs(heights) < quiet * band)
        if (heights < -2.0 * band).mean() < BELOW_SHARE and height_m > 0.0:
            rms_m = float(np.sqrt((heights[on] ** 2).mean()))
            planes.append(FloorPlane(normal, height_m, rms_m, float(on.mean())))
        left &= np.abs(heights) > 2.0 * band
    return max(planes, key=lambda plane: plane.height_m, default=None)


def _plane(
    points: Array, band: Array, expected: Array, rng: np.random.Generator, total: int
) -> tuple[Array, float, float] | None:
    """Normal (3,) of the largest plane, height of the lens over it, and the share of the band that its points need;
    None where it holds too few of `total` points."""
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
    best = int((np.abs(points @ normals.T + heights) < band[:, None]).sum(axis=0).argmax())
    normal, height_m, quiet = normals[best], float(heights[best]), 1.0
    for _ in range(6):  # least squares
        off = np.abs(points @ normal + height_m) / band
        on = off < quiet
        if on.sum() < max(MINIMUM_POINTS, MINIMUM_SHARE * total):
            return None
        quiet = float(np.clip(BAND * NORMAL * np.median(off[on]), QUIETEST, 1.0))
        weights = 1.0 / band[on] ** 2
        centre = (weights[:, None] * points[on]).sum(axis=0) / weights.sum()
        offsets = points[on] - centre
        normal = np.linalg.eigh((offsets * weights[:, None]).T @ offsets)[1][:, 0]
        normal = normal * (-1.0 if normal @ expected < 0.0 else 1.0)
        height_m = -float(normal @ centre)
    return (normal, height_m, quiet) if normal @ expected > math.cos(STEEPEST_RAD) else None
