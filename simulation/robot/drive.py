"""The robot: smooth differential-drive ways through a room's free floor, and what its wheels believe."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.interpolate import BSpline
from scipy.ndimage import distance_transform_edt, map_coordinates

from edgemap.geometry.se2 import SE2
from edgemap.simulation.apartment.apartment import Apartment
from edgemap.simulation.render.mesh import Array

_CELL_M = 0.03
# Headings tried per control point of a way, and the sharpest turn at one.
_TRIES, _SHARPEST_RAD = 40, 1.7


@dataclass(frozen=True, slots=True)
class Limits:
    """What the robot can do: radius and clearance beyond it in metres, m/s, m/s^2 and rad/s."""

    radius_m: float = 0.18
    margin_m: float = 0.08
    speed_m_s: float = 0.45
    acceleration_m_s2: float = 0.35
    yaw_rate_rad_s: float = 0.7


class FreeSpace:
    """Distance from any point of the floor to the nearest wall or piece of furniture."""

    def __init__(self, apartment: Apartment) -> None:
        columns, rows = (math.ceil(side / _CELL_M) for side in (apartment.shell.width_m, apartment.shell.depth_m))
        x, y = np.meshgrid((np.arange(columns) + 0.5) * _CELL_M, (np.arange(rows) + 0.5) * _CELL_M)
        free = np.ones((rows, columns), dtype=bool)
        free[[0, -1]] = free[:, [0, -1]] = False
        points = np.stack([x, y], axis=-1).reshape(-1, 2)
        for item in apartment.furniture:
            if item.on_floor:
                local = np.abs(item.pose_home_object.inverse().apply(points))
                inside = (local <= [item.model.depth_m / 2.0, item.model.width_m / 2.0]).all(axis=1)
                free &= ~inside.reshape(rows, columns)
        self._distance_m = np.asarray(distance_transform_edt(free), dtype=np.float64) * _CELL_M
        self.size_m = np.array([apartment.shell.width_m, apartment.shell.depth_m])

    def clearance_m(self, points_m: Array) -> Array:
        """Distances (N,) for points (N, 2); 0 outside the room. Good to half a cell (1.5 cm)."""
        points = np.asarray(points_m, dtype=np.float64).reshape(-1, 2)
        cells = points[:, ::-1].T / _CELL_M - 0.5
        return np.asarray(map_coordinates(self._distance_m, cells, order=1, mode="constant", cval=0.0))


def random_way(free: FreeSpace, limits: Limits, rng: np.random.Generator, knots: int) -> Array | None:
    """A smooth way of points (N, 2), about 1 cm apart, with clearance all along; None where this try failed.

    Control points are a random walk with free lines of sight and no sharp turns; a cubic B-spline rounds them off.
    """
    need = limits.radius_m + limits.margin_m
    points = [_free_point(free, need + 0.1, rng)]
    along = np.linspace(0.0, 1.0, 10)[:, None]
    ahead = None
    while len(points) < knots:
        heading = rng.uniform(-math.pi, math.pi, _TRIES)
        steps = rng.uniform(0.6, 1.7, (_TRIES, 1)) * np.stack([np.cos(heading), np.sin(heading)], axis=1)
        lines = points[-1] + along * steps[:, None]
        good = free.clearance_m(lines.reshape(-1, 2)).reshape(_TRIES, -1).min(axis=1) > need
        if ahead is not None:
            good &= np.abs(np.mod(heading - ahead + math.pi, 2.0 * math.pi) - math.pi) < _SHARPEST_RAD
        if not good.any():
            return None
        first = int(np.argmax(good))
        points.append(points[-1] + steps[first])
        ahead = heading[first]
    way = _spline(np.array(points))
    return way if free.clearance_m(way).min() > need else None


def drive_along(way_m: Array, limits: Limits, frames: int, rate_hz: float) -> list[SE2] | None:
    """Poses `frames` long at `rate_hz` that follow a way from rest to rest; None where the way is too short.

    A way that takes longer is cut. Speed keeps to the limits of speed, acceleration and yaw rate; then the whole
    drive is slowed a little to fill the time.
    """
    available = (frames - 1) / rate_hz
    time, heading = _timed(way_m, limits)
    if time[-1] > available:
        # Stopping takes time too: half of speed / acceleration beyond what the uncut way took to get here.
        stop = 0.5 * limits.speed_m_s / limits.acceleration_m_s2 + 0.2
        way_m = way_m[: max(8, int(np.searchsorted(time, available - stop)))]
        time, heading = _timed(way_m, limits)
    if not 0.85 * available <= time[-1] <= available:
        return None
    stamps = np.arange(frames) / rate_hz * time[-1] / available
    x, y = (np.interp(stamps, time, way_m[:, axis]) for axis in range(2))
    yaw = np.interp(stamps, (time[1:] + time[:-1]) / 2.0, heading)
    return [SE2(*pose) for pose in zip(x, y, yaw, strict=True)]


def _timed(way_m: Array, limits: Limits) -> tuple[Array, Array]:
    """When the robot is at each point of a way (N,), seconds, and its heading on each step (N - 1,), unwrapped."""
    steps = np.diff(way_m, axis=0)
    length = np.linalg.norm(steps, axis=1)
    heading = np.unwrap(np.arctan2(steps[:, 1], steps[:, 0]))
    curvature = np.abs(np.gradient(heading)) / np.maximum(length, 1e-6)
    curvature = np.convolve(np.pad(curvature, 15, mode="edge"), np.ones(31) / 31, mode="valid")
    allowed = np.minimum(limits.speed_m_s, limits.yaw_rate_rad_s / np.maximum(curvature, 1e-6)) ** 2
    square = np.concatenate([[0.0], np.minimum(allowed[1:], allowed[:-1]), [0.0]])
    # v^2 grows by at most 2 a s along the way, and along the way back: running minima of v^2 - 2 a s.
    room = 2.0 * limits.acceleration_m_s2 * np.concatenate([[0.0], np.cumsum(length)])
    square = np.minimum.accumulate(square - room) + room
    square = np.minimum.accumulate((square + room)[::-1])[::-1] - room
    speed = np.sqrt(np.maximum(square, 0.0))
    time = np.concatenate([[0.0], np.cumsum(2.0 * length / (speed[1:] + speed[:-1]))])
    return time, heading


def wheel_odometry(poses: Sequence[SE2], rng: np.random.Generator) -> list[SE2]:
    """What the wheels believe, starting at the identity: scale errors of the drive, noise with every metre and
    radian, and now and then a slip of some centimetres or a degree or two."""
    stretch, twist = 1.0 + rng.normal(0.0, 0.012), 1.0 + rng.normal(0.0, 0.025)
    drift = rng.normal(0.0, 0.006)
    believed = [SE2()]
    for before, after in pairwise(poses):
        motion = before.inverse() @ after
        slips = rng.random() < 0.03
        forward = motion.x_m * stretch + rng.normal(0.0, 0.03 * abs(motion.x_m) + 2e-4)
        forward *= 1.0 + (rng.uniform(0.1, 0.5) if slips else 0.0)
        turn = motion.yaw_rad * twist + drift * motion.x_m + rng.normal(0.0, 0.03 * abs(motion.yaw_rad) + 3e-4)
        turn += rng.normal(0.0, 0.012) if slips else 0.0
        believed.append(believed[-1] @ SE2(forward, motion.y_m, turn))
    return believed


def _free_point(free: FreeSpace, clearance_m: float, rng: np.random.Generator) -> Array:
    while True:
        point = rng.uniform(0.0, 1.0, 2) * free.size_m
        if free.clearance_m(point)[0] > clearance_m:
            return point


def _spline(control: Array, spacing_m: float = 0.01) -> Array:
    """Clamped uniform cubic B-spline of control points (N, 2), resampled evenly."""
    count = len(control)
    knots = np.concatenate([np.zeros(3), np.arange(count - 2), np.full(3, count - 3)]).astype(np.float64)
    dense = BSpline(knots, control, 3)(np.linspace(0.0, count - 3, 200 * count))
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(dense, axis=0), axis=1))])
    even = np.linspace(0.0, along[-1], max(8, int(along[-1] / spacing_m)))
    return np.stack([np.interp(even, along, dense[:, axis]) for axis in range(2)], axis=1)
