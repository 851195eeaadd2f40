"""The trajectory: keyframe poses with the odometry between them, and its correction."""

import math
from collections.abc import Callable, Set
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
    """Keyframes in order. The odometer counts a rotation of one radian as a metre: both make odometry drift."""

    def __init__(self, rule: KeyframeRule | None = None) -> None:
        self.rule = rule or KeyframeRule()
        self.poses: list[SE2] = []
        self.covariances: list[Array] = []  # of them
        self.stamps_s: list[float] = []
        self.since = SE2()  # the base in the last keyframe
        self.odometer_m = 0.0
        self._since_covariance = np.zeros((3, 3))
        # Motions between the keyframes with two covariances (2, 3, 3): their own, and the one to search loops with.
        self._steps: list[tuple[SE2, Array]] = []
        self._vectors = np.zeros((0, 3))
        self._first, self._first_information = np.zeros(3), FIXED
        self._turned_rad = 0.0  # the sum of all yaws
        self._headings: list[tuple[float, float]] = []  # of the keyframes, by it, and its variance

    def __len__(self) -> int:
        return len(self.poses)

    @property
    def pose(self) -> SE2:
        """Pose of the base in the map."""
        return self.poses[-1] @ self.since

    @property
    def covariance(self) -> Array:
        """Covariance of that pose."""
        return compose_covariance(self.poses[-1], self.covariances[-1], self.since, self._since_covariance)

    def begin(self, pose: SE2, covariance: Array, stamp_s: float) -> None:
        """Adds the first keyframe with its covariance."""
        self.poses, self.stamps_s, self._first = [pose], [stamp_s], pose.vector()
        self.covariances = [covariance]
        self._headings, self._turned_rad = [(pose.yaw_rad, math.inf)], pose.yaw_rad
        self._first_information = inverse(covariance + inverse(FIXED))

    def is_due(self, motion: SE2, covariance: Array) -> bool:
        """Adds a motion. Returns whether the next keyframe is due."""
        self.odometer_m += math.hypot(motion.x_m, motion.y_m) + abs(motion.yaw_rad)
        self._turned_rad += motion.yaw_rad
        self._since_covariance = compose_covariance(self.since, self._since_covariance, motion, covariance)
        self.since = self.since @ motion
        far = math.hypot(self.since.x_m, self.since.y_m) > self.rule.keyframe_m
        return far or abs(self.since.yaw_rad) > self.rule.keyframe_m

    def keep(self, stamp_s: float, heading_rad2: float = math.inf) -> None:
        """Makes the current pose a keyframe. heading_rad2: variance of the sum of all yaws up to here."""
        self.covariances.append(self.covariance)
        path_m2 = (self.rule.slip * math.hypot(self.since.x_m, self.since.y_m)) ** 2 + EXACT**2
        turn_rad2 = (self.rule.slip * self.since.yaw_rad) ** 2 + EXACT**2
        least = np.stack([np.eye(3) * EXACT**2, np.diag([path_m2, path_m2, turn_rad2])])
        self._steps.append((self.since, self._since_covariance + least))
        self.poses.append(self.pose)
        self.stamps_s.append(stamp_s)
        self._headings.append((self._turned_rad, heading_rad2))
        self.since, self._since_covariance = SE2(), np.zeros((3, 3))

    def factors(self, loose: bool = False) -> OdometryFactors:
        """The keyframes' odometry factors. loose: with the covariances that loops are searched with."""
        motions = np.array([motion.vector() for motion, _ in self._steps]).reshape(-1, 3)
        covariances = np.array([covariances[int(loose)] for _, covariances in self._steps]).reshape(-1, 3, 3)
        headings = np.array(self._headings).reshape(-1, 2)
        # Their error is mostly the room's, which all share: together they have the information of one.
        measured = int(np.isfinite(headings[:, 1]).sum())
        heading_information = 1.0 / (headings[:, 1] * max(measured, 1))
        first = self._first, self._first_information, self.rule.gain
        return OdometryFactors(motions, inverse(covariances), *first, headings[:, 0], heading_information)

    def vectors(self) -> Array:
        """All keyframes' poses, (K, 3)."""
        count = len(self._vectors)
        if count != len(self.poses):
            new = np.array([pose.vector() for pose in self.poses[count:]]).reshape(-1, 3)
            self._vectors = np.concatenate([self._vectors, new])
        return self._vectors

    def set_poses(self, poses: Array, covariances: Array, now_s: float) -> TrajectoryCorrection:
        """The first keyframes have the poses (N, 3); later ones follow the last of these by odometry. Observations
        from `now_s` on refer to the corrected pose of the base.
        """
        after = [SE2(*pose) for pose in poses]
        for motion, (own, _) in self._steps[len(after) - 1 :]:
            following = compose_covariance(after[-1], covariances[-1], motion, own)
            covariances = np.concatenate([covariances, following[None]])
            after.append(after[-1] @ motion)
        before = self.vectors()
        now = np.array([pose.vector() for pose in after]).reshape(-1, 3)
        turned = np.column_stack([np.zeros((len(now), 2)), now[:, 2] - before[:, 2]])
        moves = composed(turned, np.column_stack([-before[:, :2], np.zeros(len(now))]))
        moves[:, :2] += now[:, :2]
        self.poses, self.covariances, self._vectors = after, list(covariances), now
        return TrajectoryCorrection(
            np.array([*self.stamps_s, max(now_s, self.stamps_s[-1])]),
            np.concatenate([moves, np.zeros((1, 3))]),
            np.concatenate([now, self.pose.vector()[None]]),
            np.concatenate([covariances, self.covariance[None]]),
        )

    def replace_motions(
        self, path: Callable[[float], SE2 | None], now_s: float, in_map: bool = False
    ) -> TrajectoryCorrection:
        """The motions between keyframes are those of another path, by stamp, where it has one. in_map: it is in the
        map's frame, so that the first pose is its too."""
        at = [path(stamp_s) for stamp_s in (*self.stamps_s, now_s)]
        moved = [None if a is None or b is None else a.inverse() @ b for a, b in pairwise(at)]
        self._steps = [(new or old, both) for new, (old, both) in zip(moved[:-1], self._steps, strict=True)]
        self.since = moved[-1] or self.since
        first = at[0].vector()[None] if in_map and at[0] is not None else self.vectors()[:1]
        return self.set_poses(first, np.array(self.covariances[:1]), now_s)

    def drop(self, gone: Set[int]) -> None:
        """Removes keyframes, except the first and the last; the motions before and after each are composed."""
        steps = list[tuple[SE2, Array]]()
        for before, (motion, covariances) in enumerate(self._steps):
            if before in gone:
                earlier, others = steps.pop()
                motion, covariances = earlier @ motion, compose_covariance(earlier, others, motion, covariances)
            steps.append((motion, covariances))
        self._steps = steps
        self.poses = [pose for row, pose in enumerate(self.poses) if row not in gone]
        self.covariances = [covariance for row, covariance in enumerate(self.covariances) if row not in gone]
        self._vectors = np.zeros((0, 3))
        self.stamps_s = [stamp_s for row, stamp_s in enumerate(self.stamps_s) if row not in gone]
        self._headings = [heading for row, heading in enumerate(self._headings) if row not in gone]
