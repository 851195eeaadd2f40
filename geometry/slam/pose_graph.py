"""A drive as a graph: keyframes, the odometry between them, observations of landmarks, and links between landmarks."""

import math
from collections.abc import Generator, Iterable, Mapping, Sequence, Set
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.optimize import linear_sum_assignment

from edgemap.geometry.arrays import CHI2_997, Array, inverse, positive
from edgemap.geometry.map_object import MapObject, SightingSums
from edgemap.geometry.observations.class_extents import footprint_m
from edgemap.geometry.observations.sighting import PlacedSighting
from edgemap.geometry.se2 import SE2, by_pose, wrap_angles
from edgemap.geometry.slam.keyframes import KeyframeRule, KeyframeTrajectory
from edgemap.geometry.slam.least_squares import OdometryFactors, Problem, Rows, Solution, solve
from edgemap.geometry.slam.loop_hypotheses import LoopHypothesisRule
from edgemap.geometry.slam.object_landmarks import (
    Landmark,
    LandmarkRule,
    factors,
    observations,
    observed,
    rotations,
    stacked,
)
from edgemap.geometry.trajectory_correction import TrajectoryCorrection, composed, nearest_earlier

Links = Mapping[int, int]  # of a later landmark to the first one of its object
Evidence = frozenset[tuple[int, int, int]]  # of a hypothesis: its links, and how often each later landmark was observed


@dataclass(frozen=True, slots=True)
class GraphRule:
    """Parameters of the pose graph."""

    freedom: float = 4.0  # degrees of freedom of odometry's errors (Student's t): a few motions slip, most do not
    maximum: int = 80  # landmarks solved for
    visits: int = 3  # to one object, kept apart so that a wrong link can be revoked; older ones become one
    every: int = 4  # keyframes between two closures
    keyframes: KeyframeRule = field(default_factory=KeyframeRule)
    landmarks: LandmarkRule = field(default_factory=LandmarkRule)
    hypotheses: LoopHypothesisRule = field(default_factory=LoopHypothesisRule)


@dataclass(frozen=True, slots=True, eq=False)
class Snapshot:
    """All factors at one time, so that all hypotheses are tested on the same data. rows: of each landmark, by number.
    problem: without links, each landmark being an object. loose: the odometry that loops are searched with. poses (K,
    3), biases (3,): to start from.
    """

    rows: dict[int, int]
    problem: Problem
    loose: OdometryFactors
    poses: Array
    biases: Array

    def ties(self, links: Links) -> dict[int, int]:
        """Links between two of these landmarks."""
        return {later: first for later, first in links.items() if later in self.rows and first in self.rows}

    def objects(self, links: Links) -> tuple[dict[int, int], Rows]:
        """The objects by these links: the row of each object, by the number of its first landmark; and the row of each
        landmark's object, (L,)."""
        ties, first = self.ties(links), list[int]()
        for number in self.rows:
            while number in ties:
                number = ties[number]
            first.append(number)
        row = {number: at for at, number in enumerate(dict.fromkeys(first))}
        return row, np.array([row[number] for number in first], dtype=np.intp)

    def solved(
        self, links: Links, *, loose: bool = False, start: Solution | None = None, iterations: int = 6
    ) -> Generator[None, None, Solution]:
        """Least squares with these links. loose: with the odometry that loops are searched with, and no robust kernel.
        start: initial values instead of the current ones."""
        row, owner = self.objects(links)
        apart, places_m, priors = self.problem, np.zeros((len(row), 2)), np.zeros((len(row), 2, 2))
        has_prior = apart.priors.any(axis=(1, 2))
        for some in (~has_prior, has_prior):
            places_m[owner[some]], priors[owner[some]] = apart.landmarks_m[some], apart.priors[some]
        seen = replace(apart.observations, landmark=owner[apart.observations.landmark])
        problem = replace(apart, observations=seen, landmarks_m=places_m, priors=priors)
        if loose:
            problem = replace(problem, odometry=self.loose, kernel=math.inf, freedom=math.inf)
        poses, biases = (self.poses, self.biases) if start is None else (start.poses, start.biases)
        return (yield from solve(problem, poses, biases, iterations))

    def link_chi2(self, links: Links, solution: Solution) -> dict[int, float]:
        """Squared Mahalanobis distance of each linked landmark, by number, from where all others of its object are."""
        _, owner = self.objects(links)
        seen, priors = self.problem.observations, self.problem.priors
        poses, local = solution.poses[seen.pose], seen.position_m - solution.biases[-1] * seen.bias_m
        places = composed(poses, np.column_stack([local, np.zeros(len(local))]))[:, :2, None]
        rotation = rotations(poses[:, 2])
        observed = rotation @ seen.information @ rotation.transpose(0, 2, 1)
        information, vector = priors.copy(), priors @ self.problem.landmarks_m[:, :, None]
        np.add.at(information, seen.landmark, observed)
        np.add.at(vector, seen.landmark, observed @ places)
        chi2: dict[int, float] = {}
        for number in self.ties(links):
            row = self.rows[number]
            others = (owner == owner[row]) & (np.arange(len(owner)) != row)
            covariances = inverse(np.stack([information[row], information[others].sum(axis=0)]))
            here, there = covariances @ np.stack([vector[row], vector[others].sum(axis=0)])
            chi2[number] = float(((here - there).T @ np.linalg.solve(covariances.sum(axis=0), here - there)).item())
        return chi2


class PoseGraph:
    """Takes every frame's motion and sightings. Every visit to an object is a separate landmark; a link makes two
    landmarks observations of one object, each from one side.

    landmarks: by number, in order of appearance. links: the landmark that each later one is linked to. accepted: number
    of links that loop closure made and did not revoke. refused: revoked links. unlikely: the last hypothesis that was
    not accepted. tilt_rad: roll and pitch (2,) by which the mount's angles differ from the stated ones.
    least_pictures: of 0.1 s that make a landmark one to close loops with.
    """

    def __init__(self, rule: GraphRule | None = None, least_pictures: float = 4.0) -> None:
        self.rule, self.least_pictures = rule or GraphRule(), least_pictures
        self.trajectory = KeyframeTrajectory(self.rule.keyframes)
        self.landmarks: dict[int, Landmark] = {}
        self.links: dict[int, int] = {}
        self.accepted = 0
        self.refused: set[tuple[int, int]] = set()
        self.unlikely: Evidence = frozenset()
        self.tilt_rad = np.zeros(2)
        self._biases = np.zeros(3)
        self._issued = 0
        self._in_view: list[Landmark] = []

    def begin(self, label: str, extent_m: float, saved: MapObject | None = None) -> Landmark:
        """A new landmark, of an object of an earlier map where that is given."""
        observed_at_m = self.trajectory.odometer_m if saved is None else -math.inf
        landmark = self.landmarks[self._issued] = Landmark(self._issued, label, extent_m, observed_at_m, saved)
        self._in_view.append(landmark)
        self._issued += 1
        return landmark

    def add_saved(self, item: MapObject) -> Landmark:
        """Adds an object of an earlier map, in the trajectory's frame; observed again, it corrects the pose. A map does
        not state the common part of its objects' uncertainty, so all of it except the variance between sides counts as
        individual.
        """
        landmark = self.begin(item.label, item.width_m, item)
        landmark.sums = SightingSums.of_saved(item)
        landmark.position_m = item.position_m
        centre_m2 = self.rule.landmarks.centre_m2(max(footprint_m(item.label, item.width_m)))
        landmark.own_m2 = positive(item.covariance_m2 - np.eye(2) * centre_m2, least=1e-4)
        return landmark

    def observe(self, sightings: Sequence[PlacedSighting]) -> list[Landmark]:
        """Adds one frame's sightings. Returns the landmark of each. The first frame's pose is the first keyframe, if
        there is none yet.
        """
        if not sightings:
            return []
        trajectory, rule = self.trajectory, self.rule.landmarks
        if not len(trajectory):
            first = sightings[0]
            trajectory.begin(first.pose_map_base, first.pose_covariance, first.sighting.stamp_s)
        keyframe, to_keyframe = len(trajectory) - 1, SE2(*trajectory.poses[-1]).inverse()
        landmarks = self._associated(sightings)
        for landmark, placed in zip(landmarks, sightings, strict=True):
            since = to_keyframe @ placed.pose_map_base
            landmark.add(keyframe, observed(placed, since, self.tilt_rad, rule.repeated))
            landmark.sums.add(placed)
            landmark.observed_at_m = trajectory.odometer_m
            landmark.distinct |= {
                other.number for other in landmarks if other.label == landmark.label and other is not landmark
            }
        self.place(landmarks)
        return landmarks

    def in_view(self) -> list[Landmark]:
        """The landmarks whose visit has not ended: odometry has slipped by no more than a view adds since the last
        sighting."""
        view_m = self.rule.landmarks.view_m
        self._in_view = [one for one in self._in_view if self._slip_m(one) <= view_m and not one.gone]
        return self._in_view

    def _slip_m(self, landmark: Landmark) -> float:
        """Standard deviation that odometry adds since the last sighting."""
        return self.rule.keyframes.slip * (self.trajectory.odometer_m - landmark.observed_at_m)

    def _associated(self, sightings: Sequence[PlacedSighting]) -> list[Landmark]:
        """The landmark of each sighting of one frame: the nearest in view, one to one, or a new one."""
        near = [landmark for landmark in self.in_view() if landmark.keyframes]
        cost = np.full((len(sightings), len(near) + len(sightings)), math.inf)
        np.fill_diagonal(cost[:, len(near) :], CHI2_997)  # of a new one
        for row, placed in enumerate(sightings):
            for column, landmark in enumerate(near):
                if landmark.label == placed.label:
                    cost[row, column] = self._distance2(placed, landmark)
        return [
            near[column] if column < len(near) else self.begin(placed.label, placed.sighting.extent_m)
            for column, placed in zip(linear_sum_assignment(cost)[1].tolist(), sightings, strict=True)
        ]

    def _distance2(self, placed: PlacedSighting, landmark: Landmark) -> float:
        """Squared Mahalanobis distance; infinite beyond gate or reach."""
        rule = self.rule.landmarks
        x_m, y_m = (placed.position_map_m - landmark.position_m).tolist()
        if x_m * x_m + y_m * y_m > rule.reach_m**2:
            return math.inf
        added = rule.side_m2(landmark.extent_m) + self._slip_m(landmark) ** 2
        (a, b), (_, d) = placed.covariance_m2.tolist()
        a, d = a + added, d + added
        distance2 = (d * x_m * x_m - 2.0 * b * x_m * y_m + a * y_m * y_m) / (a * d - b * b)
        return distance2 if distance2 <= CHI2_997 else math.inf

    def place(self, landmarks: Iterable[Landmark]) -> None:
        """Position and covariance of landmarks that have observations, on the current trajectory: least squares over
        observations with one range error per landmark.
        """
        landmarks = [landmark for landmark in landmarks if landmark.keyframes]
        if not landmarks:
            return
        at, rows = stacked(landmarks)
        sizes = [len(landmark.keyframes) for landmark in landmarks]
        starts = np.concatenate([[0], np.cumsum(sizes)[:-1]])
        local, information, bias, ranges = factors(rows, self.tilt_rad, self.rule.landmarks.view_m)
        pose, covariances = self.trajectory.poses[at], self.trajectory.covariances[at]
        rotation = rotations(pose[:, 2])
        lever = (rotation @ local[:, :, None])[:, :, 0]
        information = rotation @ information @ rotation.transpose(0, 2, 1)
        design = np.concatenate([np.broadcast_to(np.eye(2), (len(at), 2, 2)), rotation @ ranges[:, :, None]], axis=2)
        weighted = design.transpose(0, 2, 1) @ information
        normal = np.add.reduceat(weighted @ design, starts)
        right = np.add.reduceat((weighted @ (pose[:, :2] + lever)[:, :, None])[:, :, 0], starts)
        normal[:, 2, 2] += 1.0
        own_m2 = np.linalg.inv(normal)
        positions = (own_m2 @ right[:, :, None])[:, :2, 0]
        wrt_pose = by_pose(lever)
        from_pose = wrt_pose @ covariances @ wrt_pose.transpose(0, 2, 1)
        count = rows[:, 0]
        share = count / np.repeat(np.add.reduceat(count, starts), sizes)
        turned = rotation @ bias[:, :, None]
        shared = np.add.reduceat(share[:, None, None] * (turned @ turned.transpose(0, 2, 1)), starts)
        variance = np.add.reduceat(share * (from_pose[:, 0, 0] + from_pose[:, 1, 1]) / 2.0, starts).tolist()
        for row, landmark in enumerate(landmarks):
            landmark.position_m, landmark.own_m2 = positions[row], own_m2[row, :2, :2]
            landmark.first_m2, landmark.shared_m2 = from_pose[starts[row]], shared[row]
            landmark.variance_m2 = variance[row]

    def groups(self) -> dict[int, list[Landmark]]:
        """The landmarks of each object, by the number of the first."""
        members: dict[int, list[Landmark]] = {}
        for number, landmark in self.landmarks.items():
            members.setdefault(self.root(number), []).append(landmark)
        return members

    def root(self, number: int) -> int:
        """The first landmark of the object that one is linked to."""
        while number in self.links:
            number = self.links[number]
        return number

    def unlink(self, number: int) -> int:
        """Moves a landmark's links to its parent, or to the first landmark linked to it. Returns its number, or -1."""
        children = [later for later, first in self.links.items() if first == number]
        home = self.links.pop(number, children[0] if children else -1)
        for later in children:
            self.links[later] = home
        self.links.pop(home, None) if home in children else None
        return home

    def remove(self, numbers: Set[int]) -> None:
        """Removes landmarks and their links."""
        for number in numbers:
            self.unlink(number)
            self.landmarks.pop(number).gone = True
        for landmark in self.landmarks.values():
            landmark.distinct -= numbers
        self.refused = {pair for pair in self.refused if numbers.isdisjoint(pair)}

    def join(self, kept: Landmark, gone: Landmark) -> None:
        """Two visits to one object become one."""
        home = self.unlink(gone.number)
        if home >= 0 and home != kept.number and self.root(home) != self.root(kept.number):
            self.links[max(home, self.root(kept.number))] = min(home, self.root(kept.number))
        kept.join(gone)
        for other in self.landmarks.values():
            if gone.number in other.distinct:
                other.distinct.add(kept.number)
        kept.distinct.discard(kept.number)
        self.remove({gone.number})
        self.place([kept])

    def is_likely(self, landmark: Landmark) -> bool:
        """Whether it was observed often enough to close loops with."""
        return not landmark.gone and (landmark.saved is not None or landmark.sums.pictures >= self.least_pictures)

    def snapshot(self, wanted: Set[int]) -> Snapshot:
        """All current factors. wanted: earlier objects to include beyond the usual landmarks."""
        tied = {*self.links, *self.links.values(), *wanted}
        likely = [
            landmark
            for landmark in self.landmarks.values()
            if self.is_likely(landmark) and (landmark.keyframes or landmark.number in tied)
        ]
        near, trajectory = set(self.in_view()), self.trajectory
        likely.sort(key=lambda one: (one in near or one.number in wanted, one.number in tied, one.sums.pictures))
        chosen = sorted(likely[-self.rule.maximum :], key=lambda landmark: landmark.number)
        positions_m = np.array([landmark.position_m for landmark in chosen]).reshape(-1, 2)
        none = np.zeros((2, 2))
        priors = [none if one.saved is None else inverse(one.saved.covariance_m2) for one in chosen]
        known = positions_m, np.array(priors).reshape(-1, 2, 2)
        seen = observations(chosen, self.tilt_rad, self.rule.landmarks)
        rows = {landmark.number: at for at, landmark in enumerate(chosen)}
        problem = Problem(trajectory.factors(), seen, *known, CHI2_997, self.rule.freedom)
        return Snapshot(rows, problem, trajectory.factors(loose=True), trajectory.poses, self._biases)

    def correct(self, solution: Solution, covariances: Array, relinked: bool) -> TrajectoryCorrection | None:
        """Moves poses to the solution, with its poses' covariances (K, 3, 3). Where links are as before and no pose
        moves by more than its standard deviation, only covariances change and the result is None. relinked: whether
        links changed; poses move then in any case."""
        poses = solution.poses
        before = self.trajectory.poses[: len(poses)]
        sigmas = np.sqrt(np.diagonal(covariances, axis1=1, axis2=2))
        moved = poses - before
        moved[:, 2] = wrap_angles(moved[:, 2])
        if not relinked and (np.abs(moved) <= sigmas).all():
            self.trajectory.set_poses(before, covariances)
            return None
        self._biases = solution.biases
        return self.trajectory.set_poses(poses, covariances)

    def drop_keyframes(self) -> None:
        """Drops those keyframes of the older half that are nearest to an earlier one, a radian counting as a metre. The
        first keyframes of a place remain, so later observations are relative to them. Observations move to the
        remaining keyframe.
        """
        count, poses = len(self.trajectory), self.trajectory.poses
        into = nearest_earlier(poses[: count // 2], count - self.rule.keyframes.maximum)
        left = [row for row in range(count) if row not in into]
        onto: dict[int, tuple[int, SE2 | None]] = {row: (new, None) for new, row in enumerate(left)}
        for gone, kept in into.items():
            while kept in into:
                kept = into[kept]
            onto[gone] = onto[kept][0], SE2(*poses[kept]).inverse() @ SE2(*poses[gone])
        if into:
            self.trajectory.drop(into.keys())
            self.place([landmark for landmark in self.landmarks.values() if landmark.move_to(onto)])
