"""How a loop closure moves what was mapped: the past trajectory, and the landmarks that are known to be one."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from edgemap.geometry.arrays import Array


@dataclass(frozen=True, slots=True, eq=False)
class TrajectoryCorrection:
    """How a drive's past moved in the map: what was seen from `stamps_s[k]` until the next one, by `moves[k]`.

    stamps_s: (K,), increasing. moves: (K, 3), poses x, y, yaw of the old map frame in the new one. poses: (K, 3), of
    the base at those stamps, as known now; covariances: (K, 3, 3) of them.
    """

    stamps_s: Array
    moves: Array
    poses: Array
    covariances: Array

    def moved_poses(self, stamps_s: ArrayLike, poses: ArrayLike) -> Array:
        """Poses (N, 3) of those times (N,), x, y, yaw, where they are now."""
        return composed(self.moves[self._rows(stamps_s)], np.asarray(poses, dtype=np.float64).reshape(-1, 3))

    def moved_points(self, stamps_s: ArrayLike, points_m: ArrayLike) -> Array:
        """Points (N, 2) seen at those times (N,), where they are now."""
        points = np.asarray(points_m, dtype=np.float64).reshape(-1, 2)
        return self.moved_poses(stamps_s, np.column_stack([points, np.zeros(len(points))]))[:, :2]

    def compose(self, later: "TrajectoryCorrection") -> "TrajectoryCorrection":
        """This one and a later one as one."""
        stamps = np.union1d(self.stamps_s, later.stamps_s)
        moves, rows = later.moved_poses(stamps, self.moves[self._rows(stamps)]), later._rows(stamps)
        return TrajectoryCorrection(stamps, moves, later.poses[rows], later.covariances[rows])

    def _rows(self, stamps_s: ArrayLike) -> NDArray[np.intp]:
        return np.maximum(np.searchsorted(self.stamps_s, stamps_s, side="right") - 1, 0)


def composed(a: Array, b: Array) -> Array:
    """`SE2 @ SE2` of rows (N, 3); one row stands for all."""
    c, s = np.cos(a[:, 2]), np.sin(a[:, 2])
    yaw = np.angle(np.exp(1j * (a[:, 2] + b[:, 2])))
    return np.column_stack([a[:, 0] + c * b[:, 0] - s * b[:, 1], a[:, 1] + s * b[:, 0] + c * b[:, 1], yaw])
