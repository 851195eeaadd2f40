"""Motion without any measurement: the last velocity for a moment, then rest, with a covariance to match."""

import math
from dataclasses import dataclass, replace

import numpy as np

from edgemap.geometry.arrays import Array
from edgemap.geometry.se2 import SE2
from edgemap.runtime.frames.faults import Fault
from edgemap.runtime.motion.odometry.protocol import Motion, MotionState

# Between two steps, for a velocity; so long the last one is extrapolated, about a robot's turn before a blank wall (16
# homes, the camera alone, over 5 m: 2.9 % with 0.5 s, 2.6 with 1 s and with more); after that it may as well stand.
SHORTEST_DT_S, LONGEST_DT_S = 0.01, 1.0
EXACT, UNKNOWN = np.zeros((3, 3)), np.full(3, 1e9)  # covariance of rest; variances of a velocity before the first


@dataclass(frozen=True, slots=True)
class CoastingRule:
    """Motion of a robot at home. Metres are as of `Platform.unit_m`."""

    speed_sigma_m_s: float = 0.35  # of a small robot whose motion is unknown; the last velocity adds to it
    yaw_rate_sigma_rad_s: float = 0.5  # likewise

    def of_unit(self, unit_m: float) -> "CoastingRule":
        """The same rule in metres, for a camera that counts lengths in this unit."""
        return replace(self, speed_sigma_m_s=unit_m * self.speed_sigma_m_s)


class Coasting:
    """Guesses motion while blind.

    The velocity is filtered, so that an uncertain last motion, as by the few corners before a blank wall, is not
    repeated while nothing is seen: within LONGEST_DT_S it changes by the rule's sigmas. An unknown velocity stays
    unknown: its error grows with the time of blindness, not with its root, so the covariance of each step includes its
    correlation with the steps before: sigma^2 (t^2 - t_before^2).
    """

    def __init__(self, rule: CoastingRule | None = None) -> None:
        rule = rule or CoastingRule()
        speed, turn = rule.speed_sigma_m_s, rule.yaw_rate_sigma_rad_s
        self._change = np.array([speed, 0.5 * speed, turn])
        self._velocity, self._variance, self._sigmas = np.zeros(3), UNKNOWN, np.ones(3)
        self._last_s = self._blind_from_s = self._measured_s = -math.inf

    def saw(self, motion: SE2, stamp_s: float, covariance: Array = EXACT) -> None:
        """A measured motion that ended at a stamp, with its covariance (3, 3)."""
        dt_s = stamp_s - self._last_s
        if SHORTEST_DT_S < dt_s < LONGEST_DT_S:
            share = min((stamp_s - self._measured_s) / LONGEST_DT_S, 1.0)
            before = self._variance + self._change**2 * share
            gain = before / (before + np.diag(covariance) / dt_s**2)
            self._velocity = self._velocity + gain * (motion.vector() / dt_s - self._velocity)
            self._variance, self._sigmas = (1.0 - gain) * before, self._change + abs(self._velocity)
            self._measured_s = stamp_s
        self.begin(stamp_s)

    def begin(self, stamp_s: float) -> None:
        """Coasting starts at this stamp, up to which the motion was measured."""
        self._last_s = self._blind_from_s = stamp_s

    def guess(self, stamp_s: float, *faults: Fault | None) -> Motion:
        """The motion since the last stamp, blind, with these faults, of which some may be None."""
        if not math.isfinite(self._last_s):
            self.begin(stamp_s - LONGEST_DT_S)
        before_s = self._last_s - self._blind_from_s
        after_s = max(stamp_s - self._blind_from_s, before_s + SHORTEST_DT_S)
        self._last_s = self._blind_from_s + after_s
        carried_s = max(0.0, min(after_s, LONGEST_DT_S) - min(before_s, LONGEST_DT_S))
        covariance = np.diag(self._sigmas**2 * (after_s**2 - before_s**2))
        motion = SE2(*(self._velocity * carried_s))
        return Motion(motion, covariance, tuple(filter(None, faults)), MotionState.BLIND)
