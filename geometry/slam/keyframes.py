"""The trajectory: keyframe poses with the odometry between them, and its correction."""

import math
from collections.abc import Callable, Collection
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from edgemap.geometry.arrays import Array, inverse
from edgemap.geometry.se2 import SE2, compose_covariance
from edgemap.geometry.slam.least_squares import OdometryFactors
from edgemap.geometry.trajectory_correction import TrajectoryCorrection, composed

FIXED = np.eye(3) * 1e8  # information of a first pose that is the map's origin
EXACT = 0.0003  # m, rad: least standard deviation of any motion, whatever is stated


@dataclass(frozen=True, slots=True)
class KeyframeRule:
    """When a pose is kept, and what odometry may err by. A radian of rotation counts as a metre of path."""

    keyframe_m: float = 0.25  # m of path, or rad of rotation, after which a pose is kept
    # Standard deviation, as a share of path and rotation, added to the odometry's covariance where loops are searched:
    # a slip must not hide a loop. Whether one is closed, and what is stated, go by the odometry's covariance alone.
    slip: float = 0.05
    # Standard deviation of the share by which all paths, and all rotations, may be too long: a wrong wheel radius,
    # track or lens height repeats itself.
    gain: float = 0.01
    maximum: int = 200  # keyframes; with more, those of the older half that add least are dropped


class KeyframeTrajectory:
    """Keyframes in order. The odometer counts a rotation of one radian as a metre: both make odometry drift.

    stamps_s (K,), poses (K, 3): x, y, yaw in the map. covariances (K, 3, 3): of these. since: the base in the last one.
    """

    def __init__(self, rule: KeyframeRule | None = None) -> None:
        self.rule = rule or KeyframeRule()
        self.stamps_s, self.poses, self.covariances = np.zeros(0), np.zeros((0, 3)), np.zeros((0, 3, 3))
        self.since = SE2()
        self.odometer_m = 0.0
        self._since_covariance = np.zeros((3, 3))
        # Motions between the keyframes with two covariances (2, 3, 3): their own, and the one to search loops with.
        self._steps: list[tuple[SE2, Array]] = []
        self._first, self._first_information = np.zeros(3), FIXED
        self._now_s = -math.inf  # stamp of the last motion
        self._turned_rad = 0.0  # the sum of all yaws
        self._headings = np.zeros((0, 2))  # of the keyframes, by it, and its variance

    def __len__(self) -> int:
        return len(self.poses)

    @property
    def pose(self) -> SE2:
        """Pose of the base in the map."""
        return SE2(*self.poses[-1]) @ self.since

    @property
    def covariance(self) -> Array:
        """Covariance of that pose."""
        return compose_covariance(SE2(*self.poses[-1]), self.covariances[-1], self.since, self._since_covariance)

    def begin(self, pose: SE2, covariance: Array, stamp_s: float) -> None:
        """Adds the first keyframe with its covariance."""
        self._first, self._first_information = pose.vector(), inverse(covariance + inverse(FIXED))
        self._turned_rad, self._now_s = pose.yaw_rad, stamp_s
        self._keep(pose, covariance, stamp_s, math.inf)

    def advance(self, motion: SE2, covariance: Array, stamp_s: float, heading_rad2: float = math.inf) -> bool:
        """Adds a motion, and makes the pose after it a keyframe where one is due. heading_rad2: variance of the sum of
        all yaws up to here. Returns whether it is one."""
        self.odometer_m += math.hypot(motion.x_m, motion.y_m) + abs(motion.yaw_rad)
        self._turned_rad, self._now_s = self._turned_rad + motion.yaw_rad, stamp_s
        self._since_covariance = compose_covariance(self.since, self._since_covariance, motion, covariance)
        self.since = self.since @ motion
        path_m = math.hypot(self.since.x_m, self.since.y_m)
        if path_m <= self.rule.keyframe_m and abs(self.since.yaw_rad) <= self.rule.keyframe_m:
            return False
        path_m2 = (self.rule.slip * path_m) ** 2 + EXACT**2
        turn_rad2 = (self.rule.slip * self.since.yaw_rad) ** 2 + EXACT**2
        least = np.stack([np.eye(3) * EXACT**2, np.diag([path_m2, path_m2, turn_rad2])])
        self._steps.append((self.since, self._since_covariance + least))
        self._keep(self.pose, self.covariance, stamp_s, heading_rad2)
        self.since, self._since_covariance = SE2(), np.zeros((3, 3))
        return True

    def _keep(self, pose: SE2, covariance: Array, stamp_s: float, heading_rad2: float) -> None:
        self.stamps_s = np.append(self.stamps_s, stamp_s)
        self.poses = np.concatenate([self.poses, pose.vector()[None]])
        self.covariances = np.concatenate([self.covariances, covariance[None]])
        self._headings = np.concatenate([self._headings, [[self._turned_rad, heading_rad2]]])

    def factors(self, loose: bool = False) -> OdometryFactors:
        """The keyframes' odometry factors. loose: with the covariances that loops are searched with."""
        motions = np.array([motion.vector() for motion, _ in self._steps]).reshape(-1, 3)
        covariances = np.array([covariances[int(loose)] for _, covariances in self._steps]).reshape(-1, 3, 3)
        yaws_rad, variances_rad2 = self._headings[:, 0], self._headings[:, 1]
        # Their error is mostly the room's, which all share: together they have the information of one.
        measured = int(np.isfinite(variances_rad2).sum())
        heading_information = 1.0 / (variances_rad2 * max(measured, 1))
        first = self._first, self._first_information, self.rule.gain
        return OdometryFactors(motions, inverse(covariances), *first, yaws_rad, heading_information)

    def set_poses(self, poses: Array, covariances: Array) -> TrajectoryCorrection:
        """The first keyframes have the poses (N, 3); later ones follow the last of these by odometry. Observations
        from the last motion on refer to the corrected pose of the base.
        """
        after = [SE2(*pose) for pose in poses]
        for motion, (own, _) in self._steps[len(after) - 1 :]:
            following = compose_covariance(after[-1], covariances[-1], motion, own)
            covariances = np.concatenate([covariances, following[None]])
            after.append(after[-1] @ motion)
        before, now = self.poses, np.array([pose.vector() for pose in after]).reshape(-1, 3)
        turned = np.column_stack([np.zeros((len(now), 2)), now[:, 2] - before[:, 2]])
        moves = composed(turned, np.column_stack([-before[:, :2], np.zeros(len(now))]))
        moves[:, :2] += now[:, :2]
        self.poses, self.covariances = now, covariances
        stamps_s = np.append(self.stamps_s, max(self._now_s, self.stamps_s[-1]))
        return TrajectoryCorrection(stamps_s, np.concatenate([moves, np.zeros((1, 3))]))

    def replace_motions(self, path: Callable[[float], SE2 | None], in_map: bool) -> TrajectoryCorrection:
        """The motions between keyframes are those of another path, by stamp, where it has one. in_map: it is in the
        map's frame, so that the first pose is its too."""
        at = [path(stamp_s) for stamp_s in (*map(float, self.stamps_s), self._now_s)]
        moved = [None if a is None or b is None else a.inverse() @ b for a, b in pairwise(at)]
        self._steps = [(new or old, both) for new, (old, both) in zip(moved[:-1], self._steps, strict=True)]
        self.since = moved[-1] or self.since
        first = at[0].vector()[None] if in_map and at[0] is not None else self.poses[:1]
        return self.set_poses(first, self.covariances[:1])

    def drop(self, gone: Collection[int]) -> None:
        """Removes keyframes, except the first and the last; the motions before and after each are composed."""
        steps = list[tuple[SE2, Array]]()
        for before, (motion, covariances) in enumerate(self._steps):
            if before in gone:
                earlier, others = steps.pop()
                motion, covariances = earlier @ motion, compose_covariance(earlier, others, motion, covariances)
            steps.append((motion, covariances))
        self._steps = steps
        rows = list(gone)
        self.stamps_s, self.poses, self.covariances, self._headings = (
            np.delete(each, rows, axis=0) for each in (self.stamps_s, self.poses, self.covariances, self._headings)
        )
