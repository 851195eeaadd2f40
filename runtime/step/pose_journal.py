"""All poses of a drive, with every correction by loop closure and relocalisation applied when they are read."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from edgemap.geometry.arrays import Array
from edgemap.geometry.se2 import SE2
from edgemap.geometry.trajectory_correction import TrajectoryCorrection, composed

MAXIMUM = 65_536  # poses kept, 2 MB: all of 1.8 hours of motion at 10 Hz
SAME_S = 1e-6  # files round stamps to this


class PoseJournal:
    """Poses of the base in the map frame by stamp; repeated poses take no space, and beyond `MAXIMUM` poses every
    second one of the older half is dropped. revision: number of corrections of the past.
    """

    def __init__(self) -> None:
        self.revision = 0
        self._rows = np.zeros((MAXIMUM, 4))  # stamp_s, x_m, y_m, yaw_rad; memory is used as it fills
        self._count = 0

    def __len__(self) -> int:
        return self._count

    @property
    def stamps_s(self) -> Array:
        """Stamps (N,) of the poses that are kept, in order."""
        return self._rows[: self._count, 0].copy()

    def thinned(self, count: int) -> tuple[Array, list[SE2]]:
        """Stamps (N,) and poses of every so many that fewer than twice this count are left."""
        stamps_s = self.stamps_s[:: max(1, len(self) // count)]
        return stamps_s, [SE2(*row) for row in self.at(stamps_s).tolist()] if len(stamps_s) else []

    def append(self, stamp_s: float, pose_map_base: SE2) -> None:
        """The pose of the newest step; stamps must not run backwards."""
        row = np.array([stamp_s, *pose_map_base.vector()])
        if self._count and (row[1:] == self._rows[self._count - 1, 1:]).all():
            return
        if self._count == len(self._rows):
            half, stamps = self._count // 2, self._rows[:, 0]
            even = np.searchsorted(stamps[:half], np.linspace(stamps[0], stamps[half - 1], half // 2))
            kept = np.concatenate([self._rows[np.unique(even)], self._rows[half:]])
            self._rows[: len(kept)], self._count = kept, len(kept)
        self._rows[self._count] = row
        self._count += 1

    def correct(self, correction: TrajectoryCorrection) -> None:
        """A loop closure moved the past."""
        rows = self._rows[: self._count]
        rows[:, 1:] = correction.moved_poses(rows[:, 0], rows[:, 1:])
        self.revision += 1

    def transform(self, pose_map_start: SE2) -> None:
        """Moves all poses into another frame; `pose_map_start` is the pose of the old frame in it."""
        rows = self._rows[: self._count]
        rows[:, 1:] = composed(pose_map_start.vector()[None], rows[:, 1:])
        self.revision += self._count > 0  # without a past there is nothing to rewrite

    def at(self, stamps_s: ArrayLike) -> Array:
        """Poses (N, 3), x, y, yaw, of these stamps (N,): each the newest kept not after it, the first before all."""
        return self._rows[self._kept(stamps_s), 1:]

    def moved_poses(self, stamps_s: ArrayLike, poses: ArrayLike) -> Array:
        """Corrects poses (N, 3) of these stamps (N,), in order, estimated at one time: a pose that is not stored moves
        with the newest stored one before it, even if a correction came between the two.
        """
        poses = np.asarray(poses, dtype=np.float64).reshape(-1, 3)
        if not self._count or not len(poses):
            return poses
        kept, first, group = np.unique(self._kept(stamps_s), return_index=True, return_inverse=True)
        poses_now = [
            SE2(*now) @ SE2(*before).inverse() for now, before in zip(self._rows[kept, 1:], poses[first], strict=True)
        ]
        return composed(np.array([move.vector() for move in poses_now])[group], poses)

    def stamps_near(self, points_m: ArrayLike) -> Array:
        """Stamps (N,) of the poses nearest to points (N, 2) of the map; 0 before the first pose."""
        points, rows = np.asarray(points_m, dtype=np.float64).reshape(-1, 2), self._rows[: self._count]
        if not len(rows):
            return np.zeros(len(points))
        return np.array([rows[np.argmin(np.square(rows[:, 1:3] - point).sum(axis=1)), 0] for point in points])

    def points(self, stamps_s: ArrayLike, points_base_m: ArrayLike) -> Array:
        """Points (N, 2) of the base frame at those stamps (N,), in the map frame, all corrections applied."""
        points = np.asarray(points_base_m, dtype=np.float64).reshape(-1, 2)
        return composed(self.at(stamps_s), np.column_stack([points, np.zeros(len(points))]))[:, :2]

    def _kept(self, stamps_s: ArrayLike) -> NDArray[np.intp]:
        stamps = np.asarray(stamps_s, dtype=np.float64) + SAME_S
        return np.maximum(np.searchsorted(self._rows[: self._count, 0], stamps, side="right") - 1, 0)
