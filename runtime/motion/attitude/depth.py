"""Attitude and height of each frame from the floor in its depth picture."""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from edgemap.geometry.camera.attitude import Attitude, TrackedRotation
from edgemap.geometry.camera.depth_points import DepthPoints
from edgemap.geometry.camera.floor import FloorCamera
from edgemap.geometry.camera.floor_plane import FloorPlane, find_floor, follow_floor
from edgemap.geometry.camera.level import up_optical
from edgemap.geometry.camera.mount import Mount
from edgemap.runtime.frames.faults import Fault
from edgemap.runtime.frames.frame import Frame
from edgemap.runtime.motion.attitude.pictures import PicturesAttitude
from edgemap.runtime.motion.attitude.protocol import AttitudeSource, Moved

EVERY_PX = 12  # between the depths that are read
KEPT_S = 1.0  # for which a plane is where the next one is looked for
FARTHEST_RAD, FARTHEST_SHARE = math.radians(15.0), 0.3  # from the other source's up direction; of the mount's height
SOUGHT_S, SOUGHT_RAD, SOUGHT_SHARE = 0.5, math.radians(25.0), 0.15  # a lost floor: how often, how far off, and high
LEVEL_RAD = math.radians(0.2)  # standard deviation of the floor's slope: rugs, sills


class DepthAttitude:
    """Roll, pitch and height by the floor plane, where the depth picture shows one; else the `other` source's.

    A gyro's rotation stays the other source's. pictures: is updated with each plane.
    """

    name = "depth"

    def __init__(self, camera: FloorCamera, other: AttitudeSource, pictures: PicturesAttitude | None = None) -> None:
        self._other, self._pictures, self._height_m = other, pictures, camera.mount.height_m
        self._points = DepthPoints(camera.intrinsics, EVERY_PX)
        self._plane: FloorPlane | None = None
        self._floor: tuple[FloorPlane, NDArray[np.float64]] | None = None  # in the last picture
        self._seen_s = self._sought_s = -math.inf

    def predict(self, frame: Frame, moved: Moved | None = None) -> Attitude:
        """The attitude at the frame's stamp."""
        other = self._other.predict(frame, moved)
        self._floor = None
        if frame.depth is None:
            return other
        points = self._points.of(frame.depth)
        self._floor = plane = self._follow(points, other, frame.stamp_s)
        if plane is None:
            return other
        self._plane, self._seen_s = plane[0], frame.stamp_s
        plain = Attitude.of_up(plane[0].up, np.diag(np.diag(plane[1])[[1, 0]] + LEVEL_RAD**2), self.name)
        return replace(
            other, roll_rad=plain.roll_rad, pitch_rad=plain.pitch_rad, covariance_rad2=plain.covariance_rad2,
            height_m=plane[0].height_m, source=self.name, predicted=False,
        )  # fmt: skip

    @property
    def faults(self) -> Sequence[Fault]:
        """Those of the other source."""
        return self._other.faults

    def update(self, rotation: TrackedRotation | None) -> Attitude:
        """The attitude from depth, which also updates the other source; without floor in view, the other source's."""
        other = self._other.update(rotation)
        if self._floor is not None and self._pictures is not None:
            plane, covariance = self._floor
            self._pictures.see_up(plane.up, math.hypot(math.sqrt(covariance[:2, :2].trace() / 2.0), LEVEL_RAD))
        return other

    def correct_mount(self, mount: Mount) -> None:
        """Passes the mount to the source that is corrected."""
        self._other.correct_mount(mount)

    def reset(self, reason: str) -> None:
        """Start again from the other source's attitude."""
        self._other.reset(reason)
        self._plane = self._floor = None
        self._sought_s = -math.inf

    def _follow(
        self, points: NDArray[np.float64], other: Attitude, stamp_s: float
    ) -> tuple[FloorPlane, NDArray[np.float64]] | None:
        up = up_optical(other.pitch_rad, other.roll_rad)
        expected = [(up, other.height_m or self._height_m)]
        if self._plane is not None and stamp_s - self._seen_s < KEPT_S:
            expected.insert(0, (self._plane.up, self._plane.height_m))
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
