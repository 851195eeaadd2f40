"""The trajectory: poses every few steps with the odometry between them, and how the past moves in a correction."""

import math
from collections.abc import Mapping, Set
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from edgemap.geometry.arrays import Array
from edgemap.geometry.se2 import SE2, compose_covariance
from edgemap.geometry.slam.least_squares import OdometryFactors, inverse

FIXED = np.eye(3) * 1e8  # information of a first pose that is the map's origin


@dataclass(frozen=True, slots=True)
class KeyframeRule:
    """keyframe_m, keyframe_rad: path or rotation after which a pose is kept. inflation: of the odometry's own
    covariance, as its errors repeat from frame to frame; per_metre, per_radian, still_m, still_rad: standard deviations
    added to it. stated_inflation_yaw, stated_per_radian: instead of them for yaw, where the trajectory's covariance is
    told: loops are searched and closed with room for a slip, but errors of yaw repeat less (over 32 keyframes of six
    homes its NEES is 0.5 and 0.6 with and without wheels, by the others 0.25 and 0.3). maximum: keyframes kept; with
    more, those of the older half that tell least are dropped."""

    keyframe_m: float = 0.25
    keyframe_rad: float = 0.26
    inflation: float = 5.0
    per_metre: float = 0.03
    per_radian: float = 0.05
    still_m: float = 0.003
    still_rad: float = 0.003
    stated_inflation_yaw: float = 2.5
    stated_per_radian: float = 0.03
    maximum: int = 200


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

    def point_covariances(self, stamps_s: ArrayLike, points_m: Array) -> Array:
        """What the poses' covariances mean for points (N, 2) of the corrected map seen at those times, (N, 2, 2)."""
        rows = self._rows(stamps_s)
        x, y = (points_m - self.poses[rows, :2]).T
        wrt_pose = np.zeros((len(rows), 2, 3))
        wrt_pose[:, 0, 0] = wrt_pose[:, 1, 1] = 1.0
        wrt_pose[:, 0, 2], wrt_pose[:, 1, 2] = -y, x
        return wrt_pose @ self.covariances[rows] @ wrt_pose.transpose(0, 2, 1)

    def compose(self, later: "TrajectoryCorrection") -> "TrajectoryCorrection":
        """This one and a later one as one."""
        stamps = np.union1d(self.stamps_s, later.stamps_s)
        moves, rows = later.moved_poses(stamps, self.moves[self._rows(stamps)]), later._rows(stamps)
        return TrajectoryCorrection(stamps, moves, later.poses[rows], later.covariances[rows])

    def _rows(self, stamps_s: ArrayLike) -> NDArray[np.intp]:
        return np.maximum(np.searchsorted(self.stamps_s, stamps_s, side="right") - 1, 0)


@dataclass(frozen=True, slots=True, eq=False)
class LandmarkCorrection:
    """What a correction says of landmarks. of_track: the landmark that each track is known to be now, by their numbers.
    moves_m: how far each landmark moved, (2,). since_s: of what was seen before that stamp, poses are dropped.
    """

    of_track: Mapping[int, int] = field(default_factory=dict)
    moves_m: Mapping[int, Array] = field(default_factory=dict)
    since_s: float = -math.inf


def composed(a: Array, b: Array) -> Array:
    """`SE2 @ SE2` of rows (N, 3); one row stands for all."""
    c, s = np.cos(a[:, 2]), np.sin(a[:, 2])
    yaw = np.angle(np.exp(1j * (a[:, 2] + b[:, 2])))
    return np.column_stack([a[:, 0] + c * b[:, 0] - s * b[:, 1], a[:, 1] + s * b[:, 0] + c * b[:, 1], yaw])


class KeyframeTrajectory:
    """Keyframes in order. The odometer counts a rotation of one radian as a metre: both make odometry drift."""

    def __init__(self, rule: KeyframeRule | None = None) -> None:
        self.rule = rule or KeyframeRule()
        self.poses: list[SE2] = []
        self.stamps_s: list[float] = []
        self.since = SE2()  # the base in the last keyframe
        self.odometer_m = 0.0
        self._since_covariance = np.zeros((3, 3))
        self._motions: list[SE2] = []
        self._covariances: list[Array] = []
        self._stated: list[Array] = []  # covariances that are told
        self._first, self._first_information = np.zeros(3), FIXED

    def __len__(self) -> int:
        return len(self.poses)

    @property
    def pose(self) -> SE2:
        """Where the base is in the map."""
        return self.poses[-1] @ self.since

    def begin(self, pose: SE2, covariance: Array, stamp_s: float) -> None:
        """The first keyframe, known as well as its covariance says."""
        self.poses, self.stamps_s, self._first = [pose], [stamp_s], pose.vector()
        self._first_information = inverse(covariance + inverse(FIXED))

    def is_due(self, motion: SE2, covariance: Array) -> bool:
        """Move on; whether the next keyframe is due here."""
        self.odometer_m += math.hypot(motion.x_m, motion.y_m) + abs(motion.yaw_rad)
        self._since_covariance = compose_covariance(self.since, self._since_covariance, motion, covariance)
        self.since = self.since @ motion
        far = math.hypot(self.since.x_m, self.since.y_m) > self.rule.keyframe_m
        return far or abs(self.since.yaw_rad) > self.rule.keyframe_rad

    def keep(self, stamp_s: float) -> None:
        """The pose as it is becomes a keyframe."""
        self._motions.append(self.since)
        rule, since = self.rule, self._since_covariance
        self._covariances.append(self._inflated(since, rule.inflation, rule.per_radian))
        self._stated.append(self._inflated(since, rule.stated_inflation_yaw, rule.stated_per_radian))
        self.poses.append(self.pose)
        self.stamps_s.append(stamp_s)
        self.since, self._since_covariance = SE2(), np.zeros((3, 3))

    def _inflated(self, covariance: Array, inflation_yaw: float, per_radian: float) -> Array:
        rule, motion = self.rule, self.since
        path = (rule.per_metre * math.hypot(motion.x_m, motion.y_m)) ** 2 + rule.still_m**2
        turn = (per_radian * motion.yaw_rad) ** 2 + rule.still_rad**2
        scale = np.sqrt([rule.inflation, rule.inflation, inflation_yaw])
        return covariance * np.outer(scale, scale) + np.diag([path, path, turn])

    def factors(self, stated: bool = False) -> OdometryFactors:
        """The keyframes as a graph has them. stated: with the covariances that are told, not those that loops are
        closed with."""
        motions = np.array([motion.vector() for motion in self._motions]).reshape(-1, 3)
        covariances = np.array(self._stated if stated else self._covariances).reshape(-1, 3, 3)
        return OdometryFactors(motions, inverse(covariances), self._first, self._first_information)

    def vectors(self) -> Array:
        """All keyframes' poses, (K, 3)."""
        return np.array([pose.vector() for pose in self.poses])

    def set_poses(self, poses: Array, covariances: Array, now_s: float) -> TrajectoryCorrection:
        """The first keyframes stand at (N, 3) now; later ones follow the last of these as odometry says. What is seen
        from `now_s` on is seen from where the base is then."""
        after = [SE2(*pose) for pose in poses]
        for motion, covariance in zip(self._motions[len(after) - 1 :], self._stated[len(after) - 1 :], strict=True):
            following = compose_covariance(after[-1], covariances[-1], motion, covariance)
            covariances = np.concatenate([covariances, following[None]])
            after.append(after[-1] @ motion)
        moves = [(now @ before.inverse()).vector() for now, before in zip(after, self.poses, strict=True)]
        self.poses = after
        here = compose_covariance(after[-1], covariances[-1], self.since, self._since_covariance)
        return TrajectoryCorrection(
            np.array([*self.stamps_s, max(now_s, self.stamps_s[-1])]),
            np.array([*moves, np.zeros(3)]),
            np.array([*(pose.vector() for pose in after), self.pose.vector()]),
            np.concatenate([covariances, here[None]]),
        )

    def drop(self, gone: Set[int]) -> None:
        """Forget keyframes, neither the first nor the last: the odometry before and after one becomes one motion."""
        self._covariances, self._stated = self._joined(self._covariances, gone), self._joined(self._stated, gone)
        motions: list[SE2] = []
        for before, motion in enumerate(self._motions):
            if before in gone:
                motions[-1] = motions[-1] @ motion
            else:
                motions.append(motion)
        self._motions = motions
        self.poses = [pose for row, pose in enumerate(self.poses) if row not in gone]
        self.stamps_s = [stamp_s for row, stamp_s in enumerate(self.stamps_s) if row not in gone]

    def _joined(self, covariances: list[Array], gone: Set[int]) -> list[Array]:
        """Covariances of the motions once keyframes are dropped."""
        joined, motion = list[Array](), SE2()
        for before, covariance in enumerate(covariances):
            if before in gone:
                joined[-1] = compose_covariance(motion, joined[-1], self._motions[before], covariance)
                motion = motion @ self._motions[before]
            else:
                joined.append(covariance)
                motion = self._motions[before]
        return joined
