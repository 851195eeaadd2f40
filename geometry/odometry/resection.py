"""A camera's pose in six dimensions from points with measured depth: spatial resection (perspective-n-point)."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from edgemap.geometry.arrays import Array
from edgemap.geometry.camera.inertial import small_rotation
from edgemap.geometry.robust import ANNEALING, TUKEY, tukey

# Of a pose: whitened rows (K, 6) by rotation from the left and displacement, both in the fixed frame's axes, and
# residuals (K,).
Prior = Callable[["LensPose"], tuple[Array, Array]]


@dataclass(frozen=True, slots=True, eq=False)
class LensPose:
    """Pose of a lens in a fixed frame. rotation: (3, 3), takes its optical axes into that frame's. position_m: (3,)."""

    rotation: Array
    position_m: Array

    def inverse(self) -> "LensPose":
        """Pose of the fixed frame in this lens's frame."""
        return LensPose(self.rotation.T, -self.rotation.T @ self.position_m)

    def __matmul__(self, other: "LensPose") -> "LensPose":
        return LensPose(self.rotation @ other.rotation, other.position_m @ self.rotation.T + self.position_m)


@dataclass(frozen=True, slots=True, eq=False)
class DepthLandmarks:
    """N points in a fixed frame. points_m (N, 3); along (N, 3): derivative by their depth; sigma_m (N,): standard
    deviation of the depth.
    """

    points_m: Array
    along: Array
    sigma_m: Array


def resect(
    landmarks: DepthLandmarks, observed: Array, start: LensPose, sigma: float, prior: Prior | None = None
) -> tuple[LensPose, Array]:
    """The pose that fits normalised image points (N, 2) best, and their weights (N,), 0 of those that do not fit:
    Gauss-Newton from a start, Tukey's weights, annealed.

    sigma: standard deviation of an image point. prior: what else is measured of a pose. The error of a landmark's depth
    widens its residual along the epipolar line, so that a far one determines the rotation and a near one the
    displacement.
    """
    pose, weights = start, np.zeros(len(observed))
    for scale in ANNEALING:
        local = (landmarks.points_m - pose.position_m) @ pose.rotation
        ahead = local[:, 2] > 0.05
        x, y, z = local.T
        z = np.where(ahead, z, 1.0)
        u, v = x / z, y / z
        inverse_m, zero = 1.0 / z, np.zeros(len(z))
        residual = observed - np.column_stack([u, v])
        # By displacement and rotation of the lens in its axes: row 0 of u, row 1 of v.
        jacobian = np.array(
            [
                [-inverse_m, zero, u * inverse_m, u * v, -1.0 - u * u, v],
                [zero, -inverse_m, v * inverse_m, 1.0 + v * v, -u * v, -u],
            ]
        ).transpose(2, 0, 1)
        along = landmarks.along @ pose.rotation
        by_depth = (along[:, :2] - along[:, 2:] * np.column_stack([u, v])) * (landmarks.sigma_m * inverse_m)[:, None]
        length2 = (by_depth**2).sum(axis=1)
        lost = (1.0 - sigma / np.sqrt(sigma**2 + length2)) / np.maximum(length2, 1e-18)
        white = (residual - (lost * (by_depth * residual).sum(axis=1))[:, None] * by_depth) / sigma
        across = by_depth[:, :1] * jacobian[:, 0] + by_depth[:, 1:] * jacobian[:, 1]
        jacobian = (jacobian - (lost[:, None] * by_depth)[:, :, None] * across[:, None]) / sigma
        distance2 = (white**2).sum(axis=1)
        weights = np.where(ahead, tukey(distance2, scale * TUKEY), 0.0)
        rows, whitened = jacobian.reshape(-1, 6), white.ravel()
        weighted = rows * np.repeat(weights, 2)[:, None]
        information, right = weighted.T @ rows + 1e-6 * np.eye(6), weighted.T @ whitened
        if prior is not None:
            turned, off = prior(pose)
            turned = np.hstack([turned[:, 3:] @ pose.rotation, turned[:, :3] @ pose.rotation])
            information, right = information + turned.T @ turned, right + turned.T @ off
        step = np.asarray(np.linalg.inv(information) @ right, dtype=np.float64)
        pose = pose @ LensPose(small_rotation(*step[3:].tolist()), step[:3])
    return pose, weights


def rotation_vector(rotation: Array) -> Array:
    """Axis times angle (3,) of a small rotation (3, 3), rad."""
    skew = rotation - rotation.T
    return np.array([skew[2, 1], skew[0, 2], skew[1, 0]]) / 2.0
