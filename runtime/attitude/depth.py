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
from edgemap.geometry.robust import median_and_scatter
from edgemap.runtime.attitude.protocol import AttitudeSource
from edgemap.runtime.calibration.level import angles_text, up_optical
from edgemap.runtime.frame import Frame

JUDGED, JUDGED_S = 30, 3.0  # floors, and their time, after which the mount is called right or wrong
WRONG_RAD, WRONG_SHARE = math.radians(2.5), 0.1  # by which a mount is wrong: its angles, and its height as a share
STEADY_RAD, STEADY_SHARE = math.radians(1.2), 0.04  # median scatter of a camera that is mounted; a carried one has more
EVERY_PX = 12  # between the depths that are read
KEPT_S = 1.0  # for which a plane is where the next one is looked for
FARTHEST_RAD, FARTHEST_SHARE = math.radians(15.0), 0.3  # from what the other source says; of the mount's height
LEVEL_RAD = math.radians(0.2)  # standard deviation of the floor's own slope: rugs, sills


class DepthAttitude:
    """Roll, pitch and height by the floor plane, where the depth picture shows one; else the `other` source's.

    A mount that the first floors show to be wrong is a fault, once. A gyro's rotation stays the other source's.
    """

    name = "depth"

    def __init__(self, camera: FloorCamera, other: AttitudeSource) -> None:
        self._other, self._height_m = other, camera.mount.height_m
        self._mount = camera.mount
        self._floors: list[tuple[float, float, float, float]] = []  # stamp, roll, pitch, height as a share
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
        fault = self._judge(frame.stamp_s, plain, found[0].height_m)
        return replace(
            other, roll_rad=plain.roll_rad, pitch_rad=plain.pitch_rad, covariance_rad2=plain.covariance_rad2,
            height_m=found[0].height_m, source=self.name, predicted=False,
            fault="; ".join(filter(None, (other.fault, fault))),
        )  # fmt: skip

    def rotated(self, rotation: SeenRotation | None) -> Attitude:
        """The other source's, where no floor was in view."""
        return self._other.rotated(rotation)

    def reset(self, reason: str) -> None:
        """Start again from the other source's attitude."""
        self._other.reset(reason)
        self._plane = None

    def _judge(self, stamp_s: float, plain: Attitude, height_m: float) -> str:
        """The fault, where the first floors agree on another mount; empty ever after."""
        floors = self._floors
        if len(floors) >= JUDGED and floors[-1][0] - floors[0][0] >= JUDGED_S:
            return ""
        floors.append((stamp_s, plain.roll_rad, plain.pitch_rad, height_m / self._mount.height_m))
        if len(floors) < JUDGED or stamp_s - floors[0][0] < JUDGED_S:
            return ""
        middle, scatter = median_and_scatter(np.array(floors)[:, 1:])
        given = np.array([self._mount.roll_rad, self._mount.pitch_rad, 1.0])
        wrong = np.abs(middle - given) > [WRONG_RAD, WRONG_RAD, WRONG_SHARE]
        if not wrong.any() or (scatter > [STEADY_RAD, STEADY_RAD, STEADY_SHARE]).any():
            return ""
        roll, pitch = np.degrees(middle[:2])
        return (
            f"mount: {_told(self._mount.height_m, *np.degrees(given[1::-1]))} given, the floor in {len(floors)} depth "
            f"pictures says {_told(self._mount.height_m * middle[2], pitch, roll)}: measure it again"
        )

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


def _told(height_m: float, pitch_deg: float, roll_deg: float) -> str:
    return f"height {height_m:.2f} m, {angles_text(pitch_deg, roll_deg)}"
