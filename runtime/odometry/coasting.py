"""Motion without any measurement: the last velocity for a moment, then rest, with a covariance to match."""

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from edgemap.geometry.odometry.covariance_intersection import MotionEstimate, fused
from edgemap.geometry.se2 import SE2
from edgemap.runtime.odometry.protocol import Motion

Array = NDArray[np.float64]

YAW_RATE_CHANGES = 10.0  # rad/s, from one step to the next: that it is bounded is not used
SHORTEST_DT_S, LONGEST_DT_S = 0.01, 1.0  # between two steps, for a velocity


@dataclass(frozen=True, slots=True)
class CoastingRule:
    """carried_s: the last velocity is carried on for so long; after that the robot is as likely to stand.

    speed_sigma_m_s, yaw_rate_sigma_rad_s: of a small robot whose motion is unknown; the last velocity adds to them.
    acceleration_m_s2: standard deviation of a robot's, and of a camera's that is carried for certain.
    """

    carried_s: float = 0.5
    speed_sigma_m_s: float = 0.35
    yaw_rate_sigma_rad_s: float = 0.5
    acceleration_m_s2: tuple[float, float] = (2.0, 20.0)


class Coasting:
    """Guesses motion while blind.

    An unknown velocity stays unknown: its error grows with the time of blindness, not with its root, so the covariance
    of each step takes in its correlation with the steps before: sigma^2 (t^2 - t_before^2).
    """

    def __init__(self, rule: CoastingRule | None = None) -> None:
        self._rule = rule or CoastingRule()
        self.reset()

    def saw(self, motion: SE2, stamp_s: float) -> None:
        """A measured motion that ended at a stamp."""
        dt_s = stamp_s - self._last_s
        if SHORTEST_DT_S < dt_s < LONGEST_DT_S:
            self._velocity, speed = motion.vector() / dt_s, self._rule.speed_sigma_m_s
            self._sigmas = np.array([speed, 0.5 * speed, self._rule.yaw_rate_sigma_rad_s]) + abs(self._velocity)
        self.begin(stamp_s)

    def held(self, found: MotionEstimate, stamp_s: float, carried: float) -> MotionEstimate:
        """A motion that ended at a stamp, measured, with what the last velocity tells of it: a robot's acceleration is
        bounded, so a motion of unknown scale is (Kalman filter of the velocity).

        carried: from 0, of a robot, to 1, as of `Carried.share`.
        """
        dt_s = stamp_s - self._last_s
        if SHORTEST_DT_S < dt_s < LONGEST_DT_S:
            if self._variance is not None:
                robot, most = self._rule.acceleration_m_s2
                changes = robot * (most / robot) ** carried * dt_s
                covariance = (self._variance + np.diag([changes, changes, YAW_RATE_CHANGES]) ** 2) * dt_s**2
                expected = MotionEstimate(self._velocity * dt_s, covariance, found.source)
                both = fused(found, expected)
                found = replace(found, motion=both.motion, covariance=both.covariance)
            self._variance = found.covariance / dt_s**2
        self.saw(SE2(*found.motion), stamp_s)
        return found

    def begin(self, stamp_s: float) -> None:
        """The pose at a stamp was measured."""
        self._last_s = self._blind_from_s = stamp_s

    def guess(self, stamp_s: float, fault: str) -> Motion:
        """The motion since the last stamp, blind."""
        if not math.isfinite(self._last_s):
            self.begin(stamp_s - LONGEST_DT_S)
        before_s = self._last_s - self._blind_from_s
        after_s = max(stamp_s - self._blind_from_s, before_s + SHORTEST_DT_S)
        self._last_s = self._blind_from_s + after_s
        carried_s = max(0.0, min(after_s, self._rule.carried_s) - min(before_s, self._rule.carried_s))
        self._variance = np.diag(self._sigmas**2)
        covariance = np.diag(self._sigmas**2 * (after_s**2 - before_s**2))
        return Motion(SE2(*(self._velocity * carried_s)), covariance, fault, blind=True)

    def reset(self) -> None:
        """Forget the velocity."""
        self._velocity, self._sigmas = np.zeros(3), np.ones(3)
        self._variance: Array | None = None  # (3, 3) of the velocity; None of one that was never measured
        self._last_s = self._blind_from_s = -math.inf
