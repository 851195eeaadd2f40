"""Associates landmarks to objects."""

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from edgemap.geometry.arrays import CHI2_997, Array
from edgemap.geometry.objects.candidates import OverlapRule
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


def grouped(landmarks: Sequence[Landmark], roots: Sequence[int], rule: LandmarkRule) -> list[list[Landmark]]:
    """Groups the landmarks of one label into objects. Landmarks that loop closure linked (`roots`) form one group. Then
    the closest two groups are joined until none can be. Landmarks that were observed in one frame are never joined.
    """
    groups = list[list[Landmark]]()
    linked: defaultdict[int, list[list[Landmark]]] = defaultdict(list)
    for one, root in zip(landmarks, roots, strict=True):
        group = next((group for group in linked[root] if not any(map(one.is_distinct, group))), None)
        if group is None:
            group = []
            groups.append(group)
            linked[root].append(group)
        group.append(one)
    count = len(groups)
    if count == 1:
        return groups
    starts = np.cumsum([0, *map(len, groups[:-1])])
    sums = np.add.reduceat(_sums([one for group in groups for one in group]), starts, axis=1)
    group_of = {one.number: row for row, group in enumerate(groups) for one in group}
    is_saved = np.array([any(one.saved is not None for one in group) for group in groups])
    barred = np.outer(is_saved, is_saved) | np.eye(count, dtype=bool)
    for row, group in enumerate(groups):
        barred[row, [group_of[number] for one in group for number in one.distinct if number in group_of]] = True
    barred |= barred.T
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
        barred[kept] = barred[:, kept] = barred[kept] | barred[gone]
        barred[gone] = barred[:, gone] = True
        distance[gone] = distance[:, gone] = np.inf
        distances = np.where(barred[kept], np.inf, _distances(place[:, [kept]], place, rule)[0])
        distance[kept] = distance[:, kept] = distances


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
