"""Kalman filter of the camera's tilt without an IMU. Inputs: rotations between pictures, and measured up directions."""

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from edgemap.geometry.camera.attitude import TrackedRotation

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Tilt:
    """up: (3,), up direction, unit vector in the optical frame. covariance: (3, 3), of `up`, rad^2, rank 2."""

    up: Array
    covariance: Array

    @classmethod
    def about(cls, up: Array, sigma_rad: float) -> "Tilt":
        """A tilt with the same standard deviation about each level axis."""
        return cls(up, sigma_rad**2 * _level(up))

    def widened(self, sigma_rad: float) -> "Tilt":
        """The tilt after an unknown rotation of this standard deviation about each level axis."""
        return replace(self, covariance=self.covariance + sigma_rad**2 * _level(self.up))

    def rotated(self, rotation: TrackedRotation) -> "Tilt":
        """The tilt after a rotation of the camera."""
        back = rotation.rotation.T
        return Tilt(back @ self.up, back @ self.covariance @ rotation.rotation).widened(rotation.sigma_rad)

    def corrected(self, up: Array, sigma_rad: float, gate: float = math.inf) -> "Tilt":
        """Kalman update with an observed up direction. Beyond `gate` standard deviations, the weight of the observation
        decreases with its distance.
        """
        off = _level(self.up) @ (up - self.up)
        innovation = self.covariance + sigma_rad**2 * np.eye(3)
        beyond2 = float(off @ np.linalg.solve(innovation, off)) / gate**2
        innovation += max(beyond2 - 1.0, 0.0) * sigma_rad**2 * np.eye(3)
        gain = np.linalg.solve(innovation, self.covariance).T
        moved = self.up + gain @ off
        moved /= np.linalg.norm(moved)
        level = _level(moved)
        left = self.covariance - gain @ self.covariance
        return Tilt(moved, level @ ((left + left.T) / 2.0) @ level)

    def sigma_rad(self) -> float:
        """Standard deviation about each level axis."""
        return math.sqrt(float(np.trace(self.covariance)) / 2.0)

    def angles_covariance(self) -> Array:
        """Covariance (2, 2) of (roll, pitch), rad^2."""
        right, down, forward = self.up
        level = max(math.hypot(right, down), 1e-6)
        by_up = np.array(
            [[down / level**2, -right / level**2, 0.0], [right * forward / level, down * forward / level, -level]]
        )
        return np.asarray(by_up @ self.covariance @ by_up.T, dtype=np.float64)


def _level(up: Array) -> Array:
    """Projection (3, 3) onto the plane perpendicular to `up`."""
    return np.eye(3) - np.outer(up, up)
