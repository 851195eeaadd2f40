"""Attitude and height of each frame from the floor in its depth picture."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from edgemap.geometry.camera.attitude import Attitude, SeenRotation
from edgemap.geometry.camera.depth_points import DepthPoints
from edgemap.geometry.camera.floor import FloorCamera
from edgemap.geometry.camera.floor_plane import FloorPlane, follow_floor
from edgemap.geometry.camera.mount import Mount
from edgemap.runtime.attitude.protocol import AttitudeSource
from edgemap.runtime.calibration.level import up_optical
from edgemap.runtime.frame import Frame

EVERY_PX = 12  # between the depths that are read
KEPT_S = 1.0  # for which a plane is where the next one is looked for
FARTHEST_RAD, FARTHEST_SHARE = math.radians(15.0), 0.3  # from what the other source says; of the mount's height
LEVEL_RAD = math.radians(0.2)  # standard deviation of the floor's own slope: rugs, sills


class DepthAttitude:
    """Roll, pitch and height by the floor plane, where the depth picture shows one; else the `other` source's.

    A gyro's rotation stays the other source's.
    """

    name = "depth"

    def __init__(self, camera: FloorCamera, other: AttitudeSource) -> None:
        self._other, self._height_m = other, camera.mount.height_m
        self._points = DepthPoints(camera.intrinsics, EVERY_PX)
        self._plane: FloorPlane | None = None
        self._seen_s = -math.inf

    def step(self, frame: Frame) -> Attitude:
        """The attitude at the frame's stamp."""
        other = self._other.step(frame)
        if frame.depth is None:
            return other
        points = self._points.of(frame.depth)
        found = self._follow(points, other, frame.stamp_s)
        if found is None:
            return other
        self._plane, self._seen_s = found[0], frame.stamp_s
        plain = Attitude.of_up(found[0].up, np.diag(np.diag(found[1])[[1, 0]] + LEVEL_RAD**2), self.name)
        return replace(
            other, roll_rad=plain.roll_rad, pitch_rad=plain.pitch_rad, covariance_rad2=plain.covariance_rad2,
            height_m=found[0].height_m, source=self.name, predicted=False,
        )  # fmt: skip

    def rotated(self, rotation: SeenRotation | None) -> Attitude:
        """The other source's, where no floor was in view."""
        return self._other.rotated(rotation)

    def correct_mount(self, mount: Mount) -> None:
        """The other source's."""
        self._other.correct_mount(mount)

    def reset(self, reason: str) -> None:
        """Start again from the other source's attitude."""
        self._other.reset(reason)
        self._plane = None

    def _follow(
        self, points: NDArray[np.float64], other: Attitude, stamp_s: float
    ) -> tuple[FloorPlane, NDArray[np.float64]] | None:
        up = up_optical(other.pitch_rad, other.roll_rad)
        expected = [(up, other.height_m or self._height_m)]
        if self._plane is not None and stamp_s - self._seen_s < KEPT_S:
            expected.insert(0, (self._plane.up, self._plane.height_m))
        for direction, height_m in expected:
            found = follow_floor(points, direction, height_m)
            if found is None:
                continue
            near = abs(found[0].height_m / self._height_m - 1.0) < FARTHEST_SHARE
            if near and float(found[0].up @ up) > math.cos(FARTHEST_RAD):
                return found
        return None
