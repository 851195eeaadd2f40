"""Roll and pitch of a mount against the floor from all measurements: a Kalman filter of two constants."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np

from edgemap.geometry.arrays import Array


@dataclass(frozen=True, slots=True)
class MountTiltRule:
    """Standard deviations, in radians, of the measurements of a mount's angles.

    given: of the configured mount; wide, so that measurements can override it. nod: of the tilt in one picture, and of
    the lens's path, against the floor; a turn has one at each end. edges: of one picture of a room's edges, whose
    neighbours repeat each other. drift: of the rotation over a turn. gravity: of an accelerometer's offset (BMI055: 70
    mg, 4 degrees at most). depth: of the floor in one depth picture, whose neighbours repeat each other. lasting:
    common error of all measurements over a drive (homes 8301-8310: 0.2 degrees of pitch). gate: standard deviations
    beyond which a measurement is down-weighted.
    """

    given: float = math.radians(10.0)
    nod: float = math.radians(0.6)
    edges: float = math.radians(1.5)
    drift: float = math.radians(0.4)
    gravity: float = math.radians(2.0)
    depth: float = math.radians(2.0)
    lasting: float = math.radians(0.2)
    gate: float = 1.5


@dataclass(frozen=True, slots=True, eq=False)
class MountTilt:
    """error_rad: of the mount as given, roll and pitch (2,), to be added to it. covariance: (2, 2) of it. measurements:
    number of measurements by the name of their source.
    """

    rule: MountTiltRule
    error_rad: Array
    covariance: Array
    measurements: dict[str, int] = field(default_factory=dict)

    @classmethod
    def given(cls, rule: MountTiltRule) -> MountTilt:
        """The prior: the configured mount without measurements."""
        return cls(rule, np.zeros(2), np.eye(2) * rule.given**2)

    def by_direction(self, direction: Array, covariance: Array) -> MountTilt:
        """Update with a direction of motion: a robot on wheels moves parallel to the floor. direction: (3,), unit, of
        the lens's motion, base axes by the mount as given; covariance: (3, 3) of it.
        """
        across = math.hypot(float(direction[0]), float(direction[1]))
        variance = float(covariance[2, 2]) + self.rule.nod**2
        slope = np.array([[-direction[1], direction[0]]]) / max(across, 1e-6)
        return self._updated(
            "the direction of motion", slope, direction[2:] / max(across, 1e-6), np.array([[variance]])
        )

    def by_turn(self, turned_rad: Array) -> MountTilt:
        """Update with a rotation: a robot on wheels turns about the floor's normal. turned_rad: (3,), rotation vector,
        base axes by the mount as given.
        """
        angle = float(turned_rad[2])
        off = np.array([turned_rad[1], -turned_rad[0]]) / angle
        chord = 2.0 * math.sin(min(abs(angle), math.pi) / 2.0)
        variance = (2.0 * self.rule.nod**2 + self.rule.drift**2) / chord**2
        return self._updated("turns", np.eye(2), off, np.diag([variance] * 2))

    def by_up(self, name: str, error_rad: Array, sigma_rad: float) -> MountTilt:
        """Update with a measured up direction: roll and pitch (2,) relative to the configured mount."""
        return self._updated(name, np.eye(2), error_rad, np.diag([sigma_rad**2] * 2))

    def sigma_rad(self) -> Array:
        """Standard deviations of roll and pitch, (2,), the error common to a drive included."""
        return np.sqrt(np.diag(self.covariance) + self.rule.lasting**2)

    def _updated(self, name: str, slope: Array, residual: Array, variance: Array) -> MountTilt:
        if not np.isfinite(variance).all():
            return self
        off = residual - slope @ self.error_rad
        expected = slope @ self.covariance @ slope.T + variance
        excess = float(off @ np.linalg.solve(expected, off)) / len(off) / self.rule.gate**2
        if excess > 1.0:
            expected = expected + (excess - 1.0) * variance
        gain = np.linalg.solve(expected, slope @ self.covariance).T
        covariance = self.covariance - gain @ slope @ self.covariance
        counts = self.measurements | {name: self.measurements.get(name, 0) + 1}
        error_rad = self.error_rad + gain @ off
        return replace(self, error_rad=error_rad, covariance=(covariance + covariance.T) / 2.0, measurements=counts)
