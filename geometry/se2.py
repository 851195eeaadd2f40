"""Rigid motion in the plane, SE(2): REP-103 frames, x forward, y left, yaw counter-clockwise."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from edgemap.geometry.arrays import Array


def wrap_angle(angle_rad: float) -> float:
    """Wrap an angle to (-pi, pi]."""
    return math.pi - (math.pi - angle_rad) % (2.0 * math.pi)


def wrap_angles(angles_rad: Array) -> Array:
    """The same of an array of any shape, rad."""
    return np.angle(np.exp(1j * angles_rad))


@dataclass(frozen=True, slots=True)
class SE2:
    """A planar pose or motion: `pose_a_b` takes points of frame b into frame a.

    x_m, y_m: b's origin in a, metres. yaw_rad: b's heading in a, wrapped to (-pi, pi].
    """

    x_m: float = 0.0
    y_m: float = 0.0
    yaw_rad: float = 0.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "x_m", float(self.x_m))
        object.__setattr__(self, "y_m", float(self.y_m))
        object.__setattr__(self, "yaw_rad", wrap_angle(float(self.yaw_rad)))

    def __matmul__(self, other: "SE2") -> "SE2":
        """Compose: `pose_a_b @ pose_b_c` is `pose_a_c`."""
        c, s = math.cos(self.yaw_rad), math.sin(self.yaw_rad)
        return SE2(
            self.x_m + c * other.x_m - s * other.y_m,
            self.y_m + s * other.x_m + c * other.y_m,
            self.yaw_rad + other.yaw_rad,
        )

    def inverse(self) -> "SE2":
        """`pose_b_a` of this `pose_a_b`."""
        c, s = math.cos(self.yaw_rad), math.sin(self.yaw_rad)
        return SE2(-c * self.x_m - s * self.y_m, s * self.x_m - c * self.y_m, -self.yaw_rad)

    def apply(self, points_b_m: ArrayLike) -> Array:
        """Transforms points of frame b, shape (..., 2) in metres, to frame a; same shape."""
        points = np.asarray(points_b_m, dtype=np.float64)
        return points @ self.rotation().T + np.array([self.x_m, self.y_m])

    def rotation(self) -> Array:
        """The 2x2 rotation matrix."""
        c, s = math.cos(self.yaw_rad), math.sin(self.yaw_rad)
        return np.array([[c, -s], [s, c]])

    def matrix(self) -> Array:
        """The 3x3 homogeneous matrix."""
        matrix = np.eye(3)
        matrix[:2, :2] = self.rotation()
        matrix[:2, 2] = self.x_m, self.y_m
        return matrix

    def vector(self) -> Array:
        """(x_m, y_m, yaw_rad), shape (3,)."""
        return np.array([self.x_m, self.y_m, self.yaw_rad])

    def is_within(self, limit: float) -> bool:
        """Whether it is less than a limit in metres away, and turned by less than the same in radians."""
        return math.hypot(self.x_m, self.y_m) < limit and abs(self.yaw_rad) < limit

    def scaled(self, factor: float) -> "SE2":
        """The same heading, with the position times `factor`."""
        return SE2(factor * self.x_m, factor * self.y_m, self.yaw_rad)

    def interpolate(self, other: "SE2", share: float) -> "SE2":
        """The pose `share` of the way (0..1) to `other`, along a straight line and the shorter turn."""
        turn = wrap_angle(other.yaw_rad - self.yaw_rad)
        return SE2(
            self.x_m + share * (other.x_m - self.x_m),
            self.y_m + share * (other.y_m - self.y_m),
            self.yaw_rad + share * turn,
        )


def by_pose(levers_m: Array) -> Array:
    """Derivatives (N, 2, 3) of points by the pose x, y, yaw (m, m, rad) that carries them. levers_m (N, 2): from its
    position to the points, in its outer frame."""
    derivative = np.tile(np.eye(2, 3), (len(levers_m), 1, 1))
    derivative[:, 0, 2], derivative[:, 1, 2] = -levers_m[:, 1], levers_m[:, 0]
    return derivative


def compose_covariance(pose: SE2, pose_covariance: Array, motion: SE2, motion_covariance: Array) -> Array:
    """First-order covariance of `pose @ motion`, (..., 3, 3) in (m, m, rad), both errors independent.

    The pose's error is additive in (x, y, yaw) of its frame, and so is the motion's
    (Smith, Self and Cheeseman 1990, the compounding operation).
    """
    c, s = math.cos(pose.yaw_rad), math.sin(pose.yaw_rad)
    wrt_pose = np.array(
        [[1.0, 0.0, -s * motion.x_m - c * motion.y_m], [0.0, 1.0, c * motion.x_m - s * motion.y_m], [0.0, 0.0, 1.0]]
    )
    wrt_motion = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    return wrt_pose @ pose_covariance @ wrt_pose.T + wrt_motion @ motion_covariance @ wrt_motion.T
