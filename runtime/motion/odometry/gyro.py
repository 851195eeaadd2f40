"""Yaw from the gyro, and the accelerometer's displacement, whose velocity other odometries measure."""

from dataclasses import replace

import numpy as np

from edgemap.geometry.camera.attitude import Attitude, GyroRotation
from edgemap.geometry.se2 import SE2
from edgemap.runtime.frames.faults import Fault, FaultKind
from edgemap.runtime.frames.frame import Frame
from edgemap.runtime.motion.odometry.protocol import (
    NO_PRIOR,
    STILL,
    FramePrior,
    Motion,
    blind_motion,
    first_motion,
    no_motion,
)
from edgemap.runtime.motion.trust import UNPROVEN
from edgemap.runtime.network.network import Tensors


class GyroOdometry:
    """The gyro's rotation as of the frame's attitude, which estimates the bias at rest; a step without one is blind."""

    name, needs_features = "gyro", False

    def __init__(self) -> None:
        self._first = True

    def step(self, frame: Frame, features: Tensors, prior: FramePrior = NO_PRIOR) -> Motion:  # noqa: ARG002
        """The yaw since the last frame."""
        return self._to(frame.stamp_s, prior.attitude)

    def step_blind(self, stamp_s: float, reason: Fault, attitude: Attitude | None = None) -> Motion:  # noqa: ARG002
        """The yaw since the last frame; a gyro needs no picture."""
        return self._to(stamp_s, attitude)

    def _to(self, stamp_s: float, attitude: Attitude | None) -> Motion:
        first, self._first = self._first, False
        if first:
            return first_motion()
        if attitude is None or attitude.rotation is None:
            return blind_motion(Fault(FaultKind.GYRO, f"gyro odometry: no samples up to {stamp_s:.3f} s"))
        motion, displaced = yaw_motion(attitude.rotation), attitude.rotation.displaced
        if displaced is None:
            return motion
        moved, covariance = motion.motion, motion.covariance.copy()
        (x_m, y_m), covariance[:2, :2] = displaced
        return replace(motion, motion=SE2(x_m, y_m, moved.yaw_rad), covariance=covariance)

    def still(self, stamp_s: float, attitude: Attitude | None) -> bool | None:  # noqa: ARG002
        """Whether the yaw is within the gyro's noise."""
        if attitude is None or attitude.rotation is None:
            return None
        return abs(attitude.rotation.yaw_rad) < STILL + attitude.rotation.sigma_rad

    def rest(self, stamp_s: float) -> Motion:  # noqa: ARG002
        """No motion. Nothing to store: the next rotation begins at this stamp in any case."""
        return no_motion()


def yaw_motion(rotation: GyroRotation) -> Motion:
    """A gyro's rotation as a motion of unknown translation."""
    unproved = 0.0 if rotation.proved else UNPROVEN[2]  # it may be late, and its sign and scale wrong
    variances = [*UNPROVEN[:2], rotation.sigma_rad**2 + unproved]
    return Motion(SE2(0.0, 0.0, rotation.yaw_rad), np.diag(variances))
