"""The correction that a loop closure applies to the past trajectory and to linked landmarks; thinning."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from edgemap.geometry.arrays import Array
from edgemap.geometry.se2 import wrap_angles


@dataclass(frozen=True, slots=True, eq=False)
class TrajectoryCorrection:
    """How a drive's past moved in the map: observations from `stamps_s[k]` until the next stamp move by `moves[k]`.

    stamps_s: (K,), increasing. moves: (K, 3), poses x, y, yaw of the old map frame in the new one.
    """

    stamps_s: Array
    moves: Array

    def moved_poses(self, stamps_s: ArrayLike, poses: ArrayLike) -> Array:
        """Poses (N, 3), x, y, yaw, of those times (N,), corrected."""
        rows = np.maximum(np.searchsorted(self.stamps_s, stamps_s, side="right") - 1, 0)
        return composed(self.moves[rows], np.asarray(poses, dtype=np.float64).reshape(-1, 3))


def composed(a: Array, b: Array) -> Array:
    """`SE2 @ SE2` of rows (N, 3); a single row is broadcast."""
    c, s = np.cos(a[:, 2]), np.sin(a[:, 2])
    yaw = wrap_angles(a[:, 2] + b[:, 2])
    return np.column_stack([a[:, 0] + c * b[:, 0] - s * b[:, 1], a[:, 1] + s * b[:, 0] + c * b[:, 1], yaw])


def nearest_earlier(poses: Array, excess: int) -> dict[int, int]:
    """Of poses (N, 3), x, y, yaw in order of time, `excess` that are nearest to an earlier one, a radian counting as a
    metre: the row of each, with the row of the pose that stands for it. The first poses of a place remain."""
    if excess <= 0:
        return {}
    difference = poses[:, None] - poses[None]
    difference[..., 2] = wrap_angles(difference[..., 2])
    distance = np.linalg.norm(difference, axis=2)
    distance[np.triu_indices(len(poses))] = np.inf  # to earlier ones only
    into: dict[int, int] = {}
    for _ in range(excess):
        gone, kept = divmod(int(distance.argmin()), len(poses))
        distance[gone] = distance[:, gone] = np.inf
        into[gone] = kept
    return into
