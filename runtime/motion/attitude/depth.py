"""Attitude and height of each frame from the floor in its depth picture."""

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from edgemap.geometry.camera.attitude import Attitude
from edgemap.geometry.camera.depth_points import DepthPoints
from edgemap.geometry.camera.floor import FloorCamera
from edgemap.geometry.camera.floor_plane import FloorPlane, find_floor, follow_floor
from edgemap.geometry.camera.level import up_optical
from edgemap.runtime.frames.frame import Frame

EVERY_PX = 12  # between the depths that are read
KEPT_S = 1.0  # for which a plane is where the next one is looked for
FARTHEST_RAD, FARTHEST_SHARE = math.radians(15.0), 0.3  # from the other source's up direction; of the mount's height
SOUGHT_S, SOUGHT_RAD, SOUGHT_SHARE = 0.5, math.radians(25.0), 0.15  # a lost floor: how often, how far off, and high
LEVEL_RAD = math.radians(0.2)  # standard deviation of the floor's slope: rugs, sills


class DepthAttitude:
    """Roll, pitch and height by the floor plane, where the depth picture shows one."""

    name = "depth"

    def __init__(self, camera: FloorCamera) -> None:
        self._height_m, self._points = camera.mount.height_m, DepthPoints(camera.intrinsics, EVERY_PX)
        self.reset()

    def predict(self, frame: Frame, other: Attitude) -> Attitude:
        """The attitude at the frame's stamp: another source's, with roll, pitch and height of the floor."""
        self._floor = None
        if frame.depth is None:
            return other
        self._floor = self._follow(self._points.of(frame.depth), other, frame.stamp_s)
        if self._floor is None:
            return other
        plane, covariance = self._floor
        self._last, self._seen_s = plane, frame.stamp_s
        level = Attitude.of_up(plane.up, np.diag(np.diag(covariance)[[1, 0]] + LEVEL_RAD**2), self.name)
        return other.held_to(replace(level, height_m=plane.height_m))

    def up(self) -> tuple[NDArray[np.float64], float] | None:
        """Up (3,), optical axes, by the last frame's floor, and its standard deviation; None without floor in view."""
        if self._floor is None:
            return None
        plane, covariance = self._floor
        return plane.up, math.hypot(math.sqrt(covariance[:2, :2].trace() / 2.0), LEVEL_RAD)

    def reset(self) -> None:
        """Start again from another source's attitude."""
        self._floor: tuple[FloorPlane, NDArray[np.float64]] | None = None  # in the last picture
        self._last: FloorPlane | None = None
        self._seen_s = self._sought_s = -math.inf

    def _follow(
        self, points: NDArray[np.float64], other: Attitude, stamp_s: float
    ) -> tuple[FloorPlane, NDArray[np.float64]] | None:
        up = up_optical(other.pitch_rad, other.roll_rad)
        expected = [(up, other.height_m or self._height_m)]
        if self._last is not None and stamp_s - self._seen_s < KEPT_S:
            expected.insert(0, (self._last.up, self._last.height_m))
        for direction, height_m in expected:
            plane = follow_floor(points, direction, height_m)
            if plane is None:
                continue
            near = abs(plane[0].height_m / self._height_m - 1.0) < FARTHEST_SHARE
            if near and float(plane[0].up @ up) > math.cos(FARTHEST_RAD):
                return plane
        lost_s = stamp_s - max(self._seen_s, self._sought_s)
        return self._sought(points, up, stamp_s) if lost_s >= SOUGHT_S else None

    def _sought(
        self, points: NDArray[np.float64], up: NDArray[np.float64], stamp_s: float
    ) -> tuple[FloorPlane, NDArray[np.float64]] | None:
        """Searches the lowest plane, for a camera that is held at unexpected angles."""
        self._sought_s = stamp_s
        plane = find_floor(points, np.random.default_rng(0), up)
        if plane is None or abs(plane.height_m / self._height_m - 1.0) > SOUGHT_SHARE:
            return None
        followed = follow_floor(points, plane.up, plane.height_m)
        return followed if followed is not None and float(followed[0].up @ up) > math.cos(SOUGHT_RAD) else None
