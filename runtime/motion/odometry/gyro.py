"""Yaw from the gyro, and the accelerometer's displacement, whose velocity other odometries measure."""

import numpy as np

from edgemap.geometry.camera.attitude import Attitude
from edgemap.geometry.se2 import SE2
from edgemap.runtime.frames.faults import Fault, FaultKind
from edgemap.runtime.motion.odometry.protocol import STILL, Motion, Odometry, blind_motion
from edgemap.runtime.motion.trust import UNPROVEN


class GyroOdometry(Odometry):
    """The gyro's rotation as of the frame's attitude, which estimates the bias at rest; a step without one is blind.
    Without a state: each rotation is since the frame before."""

    name = "gyro"

    def step_blind(self, stamp_s: float, reason: Fault | None, attitude: Attitude | None = None) -> Motion:  # noqa: ARG002
        """The yaw since the last frame, of unknown translation where the accelerometer integrated none; a gyro needs no
        picture."""
        if attitude is None or attitude.rotation is None:
            return blind_motion(Fault(FaultKind.GYRO, f"gyro odometry: no samples up to {stamp_s:.3f} s"))
        rotation = attitude.rotation
        unproved = 0.0 if rotation.proved else UNPROVEN[2]  # it may be late, and its sign and scale wrong
        x_m, y_m, covariance = 0.0, 0.0, np.diag([*UNPROVEN[:2], rotation.sigma_rad**2 + unproved])
        if rotation.displaced is not None:
            (x_m, y_m), covariance[:2, :2] = rotation.displaced
        return Motion(SE2(x_m, y_m, rotation.yaw_rad), covariance)

    def still(self, stamp_s: float, attitude: Attitude | None) -> bool | None:  # noqa: ARG002
        """Whether the yaw is within the gyro's noise."""
        if attitude is None or attitude.rotation is None:
            return None
        return abs(attitude.rotation.yaw_rad) < STILL + attitude.rotation.sigma_rad
