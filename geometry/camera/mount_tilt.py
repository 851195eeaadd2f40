"""Roll and pitch of a mount against the floor from all measurements: a Kalman filter of two constants."""

import math
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from edgemap.geometry.arrays import Array
from edgemap.geometry.robust import HUBER


@dataclass(frozen=True, slots=True)
class MountTiltRule:
    """Standard deviations, in radians, of the measurements of a mount's angles."""

    prior: float = math.radians(10.0)  # of the configured mount; wide, so that measurements can override it
    # Of the tilt in one picture; a turn has one at each end. Twice the standard deviation of a robot that nods about
    # its mount: a camera whose tilt changes by more is carried.
    nod: float = math.radians(0.6)
    # Of one view of the room's edges or of the floor in depth, whose neighbours repeat each other, and of an
    # accelerometer's offset (BMI055: 70 mg, 4 degrees at most).
    seen: float = math.radians(1.5)
    lasting: float = math.radians(0.2)  # common error of all measurements of a drive (homes 8301-8310: pitch)


@dataclass(frozen=True, slots=True, eq=False)
class MountTilt:
    """error_rad: of the configured mount, roll and pitch (2,), to be added to it. covariance: (2, 2) of it.
    measurements: number of measurements by the name of their source.
    """

    rule: MountTiltRule
    error_rad: Array
    covariance: Array
    measurements: dict[str, int] = field(default_factory=dict)

    @classmethod
    def prior(cls, rule: MountTiltRule) -> "MountTilt":
        """The prior: the configured mount without measurements."""
        return cls(rule, np.zeros(2), np.eye(2) * rule.prior**2)

    def by_turn(self, turned_rad: Array) -> "MountTilt":
        """Update with a rotation: a robot on wheels turns about the floor's normal. turned_rad: (3,), rotation vector,
        base axes by the configured mount.
        """
        angle = abs(float(turned_rad[2]))
        share = abs(math.sin(angle / 2.0)) / (angle / 2.0) if angle > 0.0 else 1.0  # of the arc, its chord
        variance, least = 2.0 * self.rule.nod**2, (angle * share * self.rule.prior) ** 2
        if variance >= least:  # not more precise than the configured mount
            return self
        off = np.array([turned_rad[1], -turned_rad[0]])
        return self._updated("turns", np.eye(2) * float(turned_rad[2]), off, np.eye(2) * variance / share**2)

    def by_up(self, name: str, error_rad: Array) -> "MountTilt":
        """Update with a measured up direction: roll and pitch (2,) relative to the configured mount."""
        return self._updated(name, np.eye(2), error_rad, np.eye(2) * self.rule.seen**2)

    def sigma_rad(self) -> Array:
        """Standard deviations of roll and pitch, (2,), the error common to a drive included."""
        return np.sqrt(np.diag(self.covariance) + self.rule.lasting**2)

    def converged(self) -> NDArray[np.bool_]:
        """Whether roll and pitch have converged, bool (2,): to twice the error that is common to a drive."""
        return np.diag(self.covariance) < (2.0 * self.rule.lasting) ** 2

    def _updated(self, name: str, slope: Array, residual: Array, variance: Array) -> "MountTilt":
        off = residual - slope @ self.error_rad
        expected = slope @ self.covariance @ slope.T + variance
        excess = float(off @ np.linalg.solve(expected, off)) / len(off) / HUBER**2
        if excess > 1.0:
            expected = expected + (excess - 1.0) * variance
        gain = np.linalg.solve(expected, slope @ self.covariance).T
        covariance = self.covariance - gain @ slope @ self.covariance
        counts = self.measurements | {name: self.measurements.get(name, 0) + 1}
        error_rad = self.error_rad + gain @ off
        return replace(self, error_rad=error_rad, covariance=(covariance + covariance.T) / 2.0, measurements=counts)
