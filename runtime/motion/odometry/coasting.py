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


@dataclass(frozen=True, slots=True)
class CoastingRule:
    """Motion of a robot at home. Metres are as of `Platform.unit_m`."""

    speed_sigma_m_s: float = 0.35  # of a small robot whose motion is unknown; the last velocity adds to it
    yaw_rate_sigma_rad_s: float = 0.5  # likewise
    # Standard deviation of a robot's acceleration, and of a certainly carried camera's.
    acceleration_m_s2: tuple[float, float] = (2.0, 20.0)

    def of_unit(self, unit_m: float) -> "CoastingRule":
        """The same rule in metres, for a camera that counts lengths in this unit."""
        robot, carried = self.acceleration_m_s2
        accelerations = unit_m * robot, unit_m * carried
        return replace(self, speed_sigma_m_s=unit_m * self.speed_sigma_m_s, acceleration_m_s2=accelerations)


class Coasting:
    """Guesses motion while blind.

    An unknown velocity stays unknown: its error grows with the time of blindness, not with its root, so the covariance
    of each step includes its correlation with the steps before: sigma^2 (t^2 - t_before^2).
    """

    def __init__(self, rule: CoastingRule | None = None) -> None:
        self._rule = rule or CoastingRule()
        self.reset()

    def saw(self, motion: SE2, stamp_s: float) -> None:
        """A measured motion that ended at a stamp."""
        self._variance = None
        dt_s = stamp_s - self._last_s
        if SHORTEST_DT_S < dt_s < LONGEST_DT_S:
            self._velocity, speed = motion.vector() / dt_s, self._rule.speed_sigma_m_s
            self._sigmas = np.array([speed, 0.5 * speed, self._rule.yaw_rate_sigma_rad_s]) + abs(self._velocity)
        self.begin(stamp_s)

    def held(self, motion: Array, covariance: Array, stamp_s: float, carried: float) -> tuple[Array, Array]:
        """A measured motion (3,) that ended at a stamp, and its covariance (3, 3), after a Kalman filter of the
        velocity. Acceleration is bounded, so the last velocity also bounds a motion whose scale the camera cannot
        measure. carried: 0 for a robot to 1, as of `Carried.share`.
        """
        dt_s, variance = stamp_s - self._last_s, self._variance
        if variance is not None and SHORTEST_DT_S < dt_s < LONGEST_DT_S:
            robot, most = self._rule.acceleration_m_s2
            change = robot * (most / robot) ** carried * dt_s
            expected = np.zeros((3, 3))
            expected[:2, :2] = np.linalg.inv((variance + change**2 * np.eye(2)) * dt_s**2)
            covariance = np.asarray(np.linalg.inv(np.linalg.inv(covariance) + expected), dtype=np.float64)
            motion = motion + covariance @ expected @ (self._velocity * dt_s - motion)
        self.saw(SE2(*motion), stamp_s)
        self._variance = covariance[:2, :2] / max(dt_s, SHORTEST_DT_S) ** 2
        return motion, covariance

    def begin(self, stamp_s: float) -> None:
        """Coasting starts at this stamp, up to which the motion was measured."""
        self._last_s = self._blind_from_s = stamp_s

    def guess(self, stamp_s: float, *faults: Fault) -> Motion:
        """The motion since the last stamp, blind."""
        if not math.isfinite(self._last_s):
            self.begin(stamp_s - LONGEST_DT_S)
        before_s = self._last_s - self._blind_from_s
        after_s = max(stamp_s - self._blind_from_s, before_s + SHORTEST_DT_S)
        self._last_s = self._blind_from_s + after_s
        carried_s = max(0.0, min(after_s, LONGEST_DT_S) - min(before_s, LONGEST_DT_S))
        self._variance = np.diag(self._sigmas[:2] ** 2)
        covariance = np.diag(self._sigmas**2 * (after_s**2 - before_s**2))
        state = MotionState.COASTING if carried_s > 0.0 and self._velocity.any() else MotionState.BLIND
        return Motion(SE2(*(self._velocity * carried_s)), covariance, faults, state)

    def reset(self) -> None:
        """Discards the velocity."""
        self._velocity, self._sigmas = np.zeros(3), np.ones(3)
        self._variance: Array | None = None  # (2, 2) of the velocity; None where none was estimated
        self._last_s = self._blind_from_s = -math.inf
