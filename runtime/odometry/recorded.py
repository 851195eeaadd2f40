"""Odometry that was recorded beside the pictures: true poses, a TUM file, wheel odometry."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from edgemap.geometry.se2 import SE2
from edgemap.runtime.errors import OdometryError
from edgemap.runtime.frame import Frame
from edgemap.runtime.odometry.protocol import Motion
from edgemap.runtime.session import Tensors
from edgemap.runtime.trajectory import Trajectory


@dataclass(frozen=True, slots=True)
class DriftRate:
    """How wrong a recorded motion is. per_metre, per_radian: standard deviation as a share of way and turn;
    still_m, still_rad: what remains at rest."""

    per_metre: float = 0.0
    per_radian: float = 0.0
    still_m: float = 1e-4
    still_rad: float = 1e-5


WHEEL = DriftRate(per_metre=0.03, per_radian=0.05, still_m=1e-3, still_rad=1e-3)


class RecordedOdometry:
    """Motion between the stamps of two frames, read off a recorded trajectory of the base."""

    def __init__(self, trajectory: Trajectory, name: str, drift: DriftRate | None = None) -> None:
        self.name = name
        self._trajectory = trajectory
        self._drift = drift or DriftRate()
        self._last: SE2 | None = None

    def step(self, frame: Frame, features: Tensors) -> Motion:  # noqa: ARG002
        """The recorded motion since the last frame. Raises OdometryError where the recording does not cover it."""
        try:
            pose = self._trajectory.at(frame.stamp_s)
        except OdometryError as error:
            raise OdometryError(f"odometry {self.name}, frame {frame.index}: {error}") from None
        last, self._last = self._last, pose
        if last is None:
            return Motion()
        motion = last.inverse() @ pose
        way_m = self._drift.per_metre * math.hypot(motion.x_m, motion.y_m) + self._drift.still_m
        turn_rad = self._drift.per_radian * abs(motion.yaw_rad) + self._drift.still_rad
        return Motion(motion, np.diag([way_m**2, way_m**2, turn_rad**2]))

    def reset(self, reason: str) -> None:  # noqa: ARG002
        """Start again at the next frame."""
        self._last = None
