"""The nonholonomic constraint of wheels on a planar motion, and the estimate of the axle's position."""

import math
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from edgemap.geometry.arrays import Array
from edgemap.geometry.camera.mount import Mount
from edgemap.geometry.robust import tukey
from edgemap.geometry.se2 import SE2

ROLLED_M = 1e-3  # least standard deviation of lateral slip
MEASURED_M = 0.005  # standard deviation of a lateral motion measured in a turn, in addition to its stated one
FOLLOWED_M = 0.005  # least standard deviation of an estimated axle, so that updates continue


@dataclass(frozen=True, slots=True)
class Rolling:
    """The nonholonomic constraint of a robot on wheels: it moves along an arc, tangential to its heading at the axle.

    share: standard deviation of lateral slip, per metre and radian of motion. axle_m: distance of the wheels' axle
    behind the base's origin, 0 where the mount's lever arm is right; axle_sigma_m: its standard deviation, 0 for a
    fixed axle.
    """

    share: float
    axle_m: float
    axle_sigma_m: float

    @classmethod
    def of_mount(cls, share: float, mount: Mount) -> Self:
        """Before any motion: a lever arm that was not measured may be as long as the lens is high."""
        return cls(share, 0.0, 0.0 if mount.forward_m != 0.0 or mount.left_m != 0.0 else mount.height_m)

    def lateral_m(self, moved: SE2) -> float:
        """The part of a motion across its chord that the axle does not explain."""
        c, s = math.cos(moved.yaw_rad / 2.0), math.sin(moved.yaw_rad / 2.0)
        return c * moved.y_m - s * moved.x_m - self.axle_m * moved.yaw_rad

    def slip_m(self, moved: SE2) -> float:
        """Standard deviation of the lateral residual of about this motion."""
        slides = ROLLED_M + self.share * (math.hypot(moved.x_m, moved.y_m) + abs(moved.yaw_rad))
        return math.hypot(slides, self.axle_sigma_m * moved.yaw_rad)

    def observe(self, moved: SE2, covariance: Array) -> "Rolling":
        """Kalman update of the axle with the lateral residual of a motion of the lens. covariance: (3, 3)."""
        if self.axle_sigma_m == 0.0:
            return self
        prior, lateral_m, yaw_rad = self.axle_sigma_m**2, self.lateral_m(moved), moved.yaw_rad
        expected_m2 = float(covariance[1, 1]) + MEASURED_M**2 + prior * yaw_rad**2
        trusted = float(tukey(np.array(lateral_m**2 / expected_m2)))  # what drives sideways shows no axle
        gain = trusted * prior * yaw_rad / expected_m2
        sigma = math.sqrt(max(prior * (1.0 - gain * yaw_rad), FOLLOWED_M**2))
        return replace(self, axle_m=self.axle_m + gain * lateral_m, axle_sigma_m=sigma)
