"""The floor as a plane among 3-D points that a depth camera sees."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from edgemap.geometry.robust import NORMAL

Array = NDArray[np.float64]

STEEPEST_RAD = math.radians(45.0)  # between a plane's normal and where up is expected
TRIALS = 300
ROUNDS = 6  # of the refinement
PLANES = 4  # floor, table, seat, ceiling: the floor is the lowest of the first few
LEAST_SHARE = 0.05  # of the points, on one plane
LEAST_POINTS = 100
BELOW_SHARE = 0.02  # of the points, that noise and reflections put below a floor
NOISE_M, NOISE_PER_M = 0.01, 0.005  # of a point's height over the floor: constant, and with its depth
BAND = 2.5  # standard deviations about a plane that count as on it
QUIETEST = 0.15  # of that noise, when the plane's own points scatter less: else what stands on the floor lifts it


@dataclass(frozen=True, slots=True, eq=False)
class FloorPlane:
    """up: (3,) unit vector away from the floor, optical frame. height_m: of the lens above it. rms_m: of the points'
    distances from it. share: of all points, on it."""

    up: Array
    height_m: float
    rms_m: float
    share: float


def find_floor(points_m: Array, rng: np.random.Generator, up: Array | None = None) -> FloorPlane | None:
    """The lowest large plane below the lens, none of whose points lie below it; None where there is none.

    points_m: (N, 3), optical frame. up: (3,) as far as it is known, by gravity for one; by default the picture's own.
    RANSAC (Fischler and Bolles 1981) for one plane after the other, each refined by least squares.
    """
    expected = np.array([0.0, -1.0, 0.0]) if up is None else up / np.linalg.norm(up)
    band = BAND * (NOISE_M + NOISE_PER_M * points_m[:, 2])
    left, found = np.ones(len(points_m), dtype=bool), []
    for _ in range(PLANES):
        plane = _plane(points_m[left], band[left], expected, rng, len(points_m))
        if plane is None:
            break
        normal, height_m, quiet = plane
        heights = points_m @ normal + height_m
        on = left & (np.abs(heights) < quiet * band)
        if (heights < -2.0 * band).mean() < BELOW_SHARE and height_m > 0.0:
            rms_m = float(np.sqrt((heights[on] ** 2).mean()))
            found.append(FloorPlane(normal, height_m, rms_m, float(on.mean())))
        left &= np.abs(heights) > 2.0 * band
    return max(found, key=lambda plane: plane.height_m, default=None)


def _plane(
    points: Array, band: Array, expected: Array, rng: np.random.Generator, total: int
) -> tuple[Array, float, float] | None:
    """Normal (3,) of the largest plane, height of the lens over it, and the share of the band that its points need;
    None where it holds too few of `total` points."""
    if len(points) < LEAST_POINTS:
        return None
    corners = points[rng.integers(0, len(points), (TRIALS, 3))]
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
    for _ in range(ROUNDS):
        off = np.abs(points @ normal + height_m) / band
        on = off < quiet
        if on.sum() < max(LEAST_POINTS, LEAST_SHARE * total):
            return None
        quiet = float(np.clip(BAND * NORMAL * np.median(off[on]), QUIETEST, 1.0))
        weights = 1.0 / band[on] ** 2
        centre = (weights[:, None] * points[on]).sum(axis=0) / weights.sum()
        offsets = points[on] - centre
        normal = np.linalg.eigh((offsets * weights[:, None]).T @ offsets)[1][:, 0]
        normal = normal * (-1.0 if normal @ expected < 0.0 else 1.0)
        height_m = -float(normal @ centre)
    return (normal, height_m, quiet) if normal @ expected > math.cos(STEEPEST_RAD) else None
