"""Associates landmarks to objects, and estimates position, covariance and size of each object."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from edgemap.geometry.arrays import CHI2_997, Array
from edgemap.geometry.map_object import REPEATED, SightingSums
from edgemap.geometry.objects.class_posterior import OverlapRule
from edgemap.geometry.objects.footprint import FootprintRule
from edgemap.geometry.slam.object_landmarks import Landmark, LandmarkRule


@dataclass(frozen=True, slots=True)
class AssociationRule:
    """Evidence that landmarks need to become an object."""

    # Minimum total weight of the sightings (`BoxEvidence`), and number of pictures of 0.1 s from which on a landmark is
    # used to close loops.
    min_count: int = 4
    overlap: OverlapRule = field(default_factory=OverlapRule)
    footprint: FootprintRule = field(default_factory=FootprintRule)


class Estimate:
    """One object of several landmarks: the information-weighted mean of their positions, and its covariance.

    position_m: (2,), map frame. covariance_m2: (2, 2), including the errors that all landmarks share. saved: the object
    of an earlier map that is part of this object, if any; the object is then shown regardless of its evidence.
    """

    def __init__(self, landmarks: Sequence[Landmark], rule: LandmarkRule) -> None:
        self.sums, self._own = SightingSums(), SightingSums()  # of all runs, and of this one
        for landmark in landmarks:
            self.sums.join(landmark.sums)
            if landmark.saved is None:
                self._own.join(landmark.sums)
        self.saved = next((one.saved for one in landmarks if one.saved is not None), None)
        first = min(landmarks, key=lambda one: (one.saved is None, one.sums.first_seen_s))
        since_m2, information, vector, shared = float(np.trace(first.first_m2)) / 2.0, 0.0, 0.0, 0.0
        for one in landmarks:
            weight = np.linalg.inv(one.own_m2 + np.eye(2) * max(one.variance_m2 - since_m2, 0.0))
            information, vector = information + weight, vector + weight @ one.position_m
            shared = shared + one.shared_m2 * (one.sums.count / self.sums.count)
        fused_m2 = np.linalg.inv(information)
        centre_m2 = rule.centre_m2(sum(one.extent_m * one.sums.count for one in landmarks) / self.sums.count)
        self.position_m: Array = fused_m2 @ vector
        self.covariance_m2: Array = fused_m2 + np.eye(2) * centre_m2 + shared + first.first_m2

    def confidence(self, rule: AssociationRule) -> float:
        """Probability that an object with these sightings, of this run only, is real: the odds of their mean score to
        the power of their evidence over the evidence that an object needs. Consecutive pictures count as one. At least
        the confidence in an earlier map.
        """
        saved = self.saved.confidence if self.saved else 0.0
        if self._own.count == 0:
            return saved
        odds = self._own.weight / REPEATED / rule.min_count * math.exp(self._own.score_log_odds)
        return max(odds / (1.0 + odds), saved)


def grouped(landmarks: Sequence[Landmark], roots: Sequence[int], rule: LandmarkRule) -> list[list[Landmark]]:
    """Groups the landmarks of one label into objects. Landmarks that loop closure linked (`roots`) form one group. Then
    the closest two groups are joined until none can be. Landmarks that were observed in one frame are never joined.
    """
    groups: list[list[Landmark]] = []
    excluded: list[set[int]] = []  # landmarks that each group must not contain
    saved = {one.number for one in landmarks if one.saved is not None}
    of_root: dict[int, list[int]] = {}
    for one, root in zip(landmarks, roots, strict=True):
        barred = one.distinct | (saved - {one.number} if one.saved is not None else set())
        linked = of_root.setdefault(root, [])
        at = next((at for at in linked if one.number not in excluded[at]), None)
        if at is None:
            linked.append(len(groups))
            groups.append([one])
            excluded.append(set(barred))
        else:
            groups[at].append(one)
            excluded[at] |= barred
    if len(groups) == 1:
        return groups
    return _joined(groups, excluded, rule)


def _joined(groups: list[list[Landmark]], excluded: Sequence[set[int]], rule: LandmarkRule) -> list[list[Landmark]]:
    """Joins groups of landmarks that are within the gate, the closest two first. excluded: landmarks that each group
    must not contain."""
    count = len(groups)
    starts = np.cumsum([0, *map(len, groups[:-1])])
    sums = np.add.reduceat(_sums([one for group in groups for one in group]), starts, axis=1)
    group_of = {one.number: row for row, group in enumerate(groups) for one in group}
    barred = np.zeros((count, count), dtype=np.bool_)
    for row, numbers in enumerate(excluded):
        barred[row, [group_of[number] for number in numbers if number in group_of]] = True
    barred |= barred.T | np.eye(count, dtype=bool)
    place = _placed(sums, rule)
    distance = np.where(barred, np.inf, _distances(place, place, rule))
    while True:
        kept, gone = divmod(int(distance.argmin()), count)
        if distance[kept, gone] == np.inf:
            return [group for group in groups if group]
        groups[kept] += groups[gone]
        groups[gone] = []
        sums[:, kept] += sums[:, gone]
        place[:, [kept]] = _placed(sums[:, [kept]], rule)
        barred[kept] |= barred[gone]
        barred[:, kept] |= barred[:, gone]
        distance[gone] = distance[:, gone] = np.inf
        distances = _distances(place[:, [kept]], place, rule)[0]
        distances[[row for row, group in enumerate(groups) if not group]] = np.inf
        distance[kept] = distance[:, kept] = np.where(barred[kept], np.inf, distances)


def _sums(landmarks: Sequence[Landmark]) -> Array:
    """(8, N): information xx, xy, yy; information times position, x, y; count; count times extent and pose variance."""
    covariances = np.array([one.own_m2 for one in landmarks])
    information = np.linalg.inv(covariances)
    vector = (information @ np.array([one.position_m for one in landmarks])[:, :, None])[:, :, 0]
    count = np.array([one.sums.count for one in landmarks], dtype=np.float64)
    extent = np.array([one.extent_m for one in landmarks])
    variance = np.array([one.variance_m2 for one in landmarks])
    columns = (information[:, 0, 0], information[:, 0, 1], information[:, 1, 1], *vector.T)
    return np.array([*columns, count, extent * count, variance * count], dtype=np.float64)


def _placed(sums: Array, rule: LandmarkRule) -> Array:
    """(6, N): position, covariance xx, xy, yy without the pose's, and pose variance."""
    xx, xy, yy, vx, vy, count, extent, variance = sums
    scale = 1.0 / (xx * yy - xy * xy)
    side_m2 = (rule.side_share * extent / count) ** 2
    return np.array([
        (yy * vx - xy * vy) * scale, (xx * vy - xy * vx) * scale,
        yy * scale + side_m2, -xy * scale, xx * scale + side_m2, variance / count,
    ])  # fmt: skip


def _distances(here: Array, there: Array, rule: LandmarkRule) -> Array:
    """Squared Mahalanobis distances (M, N) from M positions (6, M) to N positions (6, N). The covariance is the sum of
    both covariances and of the pose drift between them. Infinite beyond the gate and beyond the reach."""
    here, there = here[:, :, None], there[:, None, :]
    dx, dy = there[0] - here[0], there[1] - here[1]
    drift_m2 = np.abs(there[5] - here[5])
    xx, xy, yy = here[2] + there[2] + drift_m2, here[3] + there[3], here[4] + there[4] + drift_m2
    chi2 = (yy * dx * dx - 2.0 * xy * dx * dy + xx * dy * dy) / (xx * yy - xy * xy)
    return np.where((chi2 <= CHI2_997) & (dx * dx + dy * dy <= rule.reach_m**2), chi2, np.inf)
