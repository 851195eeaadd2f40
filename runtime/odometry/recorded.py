"""Odometry that was recorded beside the pictures: true poses, a TUM file, wheel odometry."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from edgemap.geometry.se2 import SE2
from edgemap.runtime.bundle import Tensors
from edgemap.runtime.errors import OdometryError
from edgemap.runtime.frame import Frame
from edgemap.runtime.odometry.protocol import Motion
from edgemap.runtime.trajectory import Trajectory


@dataclass(frozen=True, slots=True)
class DriftRate:
    """How wrong a recorded motion is, as standard deviations.

    per_metre, per_radian: as a share of way and turn. still_m, still_rad: what remains at rest. roughness_m,
    roughness_rad: of place and heading per square root of a metre that wheels roll: small slips add up like a random
    walk (Chong and Kleeman 1997). half_track_m: what a wheel rolls per radian of turn.
    """

    per_metre: float = 0.0
    per_radian: float = 0.0
    still_m: float = 1e-4
    still_rad: float = 1e-5
    roughness_m: float = 0.0
    roughness_rad: float = 0.0
    half_track_m: float = 0.15

    def covariance(self, motion: SE2) -> NDArray[np.float64]:
        """Of one motion, (3, 3)."""
        way_m, turn_rad = math.hypot(motion.x_m, motion.y_m), abs(motion.yaw_rad)
        rolled_m = way_m + self.half_track_m * turn_rad
        place = (self.per_metre * way_m) ** 2 + self.still_m**2 + self.roughness_m**2 * rolled_m
        heading = (self.per_radian * turn_rad) ** 2 + self.still_rad**2 + self.roughness_rad**2 * rolled_m
        return np.diag([place, place, heading])


# A small robot with two driven wheels on hard floors; the simulator's wheels err so (validation drives 8101-8106).
WHEEL = DriftRate(0.01, 0.02, 4e-4, 1e-3, roughness_m=0.005, roughness_rad=0.035)


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
        return Motion(motion, self._drift.covariance(motion))

    def reset(self, reason: str) -> None:  # noqa: ARG002
        """Start again at the next frame."""
        self._last = None
