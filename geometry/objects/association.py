"""Which pools of sightings are one object: agglomeration, closest first, by distance under both covariances."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from edgemap.geometry.objects.map_object import MapObject, SightingSums
from edgemap.geometry.objects.observation_pool import ObservationPool, mean_variance

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class AssociationRule:
    """When sightings are the same thing.

    gate: squared Mahalanobis distance up to which two pools or clusters join; 13.82 holds 99.9 % of true pairs in the
    plane. max_distance_m: never farther than this. correlated: neighbouring frames repeat each other's error, so this
    many sightings weigh as one. systematic_m, systematic_extent_share: standard deviation of what no number of
    sightings takes away (a box's lower edge is not the footprint), at least, and as a share of the footprint's longer
    side. min_count (of what its sightings count, see FloorRule), min_confidence: what an object needs to show
    on the map (chosen on simulated homes). forget_after: frames after which one that does not is dropped.
    """

    gate: float = 13.82
    max_distance_m: float = 1.5
    correlated: float = 4.0
    systematic_m: float = 0.08
    systematic_extent_share: float = 0.15
    min_count: int = 4
    min_confidence: float = 0.6
    forget_after: int = 3000

    def systematic_of(self, extent_m: float) -> float:
        """Standard deviation, metres, that no number of sightings takes away from a thing of this size."""
        return max(self.systematic_m, self.systematic_extent_share * extent_m)


class Positions:
    """Pools of one label, or clusters of them, side by side in arrays.

    sums (8, N): information xx, xy, yy; vector x, y; count; extent and pose variance, each times count. place (6, N): x
    and y in m, the own covariance's xx, xy, yy and the pose's mean variance in m^2.
    """

    def __init__(self, rule: AssociationRule) -> None:
        self.rule = rule
        self.sums, self.place = np.zeros((8, 0)), np.zeros((6, 0))

    def append(self, pool: ObservationPool) -> int:
        """A row for one more pool."""
        row = self.sums.shape[1]
        self.sums, self.place = (np.pad(array, ((0, 0), (0, 1))) for array in (self.sums, self.place))
        self.set(row, pool)
        return row

    def set(self, row: int, pool: ObservationPool) -> None:
        """Take note that a pool has changed."""
        count = float(pool.sums.count)
        self.sums[:, row] = (
            *pool.information, *pool.vector, count, pool.extent_m * count, pool.variance_m2 * count
        )  # fmt: skip
        self._settle(row)

    def chosen(self, rows: Sequence[int]) -> Positions:
        """A copy of these rows."""
        part = Positions(self.rule)
        part.sums, part.place = self.sums[:, rows], self.place[:, rows]
        return part

    def join(self, kept: int, gone: int) -> None:
        """Make two rows one; the other is nowhere from then on."""
        self.sums[:, kept] += self.sums[:, gone]
        self.place[:, gone] = np.nan
        self._settle(kept)

    def distances(self, rows: slice) -> Array:
        """Squared Mahalanobis distances of M rows to all, (M, N): under both own covariances and what the pose drifted
        between the two; infinite beyond the gate and the greatest distance, and from a row to itself."""
        here, there = self.place[:, rows, None], self.place[:, None, :]
        dx, dy = there[0] - here[0], there[1] - here[1]
        drift_m2 = np.abs(there[5] - here[5])
        xx, xy, yy = here[2] + there[2] + drift_m2, here[3] + there[3], here[4] + there[4] + drift_m2
        found = (yy * dx * dx - 2.0 * xy * dx * dy + xx * dy * dy) / (xx * yy - xy * xy)
        near = (found <= self.rule.gate) & (dx * dx + dy * dy <= self.rule.max_distance_m**2)
        near[range(len(near)), range(self.place.shape[1])[rows]] = False
        return np.where(near, found, np.inf)

    def _settle(self, row: int) -> None:
        """Place, own covariance and pose variance of a row from its sums."""
        xx, xy, yy, vx, vy, count, extent, variance = self.sums[:, row].tolist()
        determinant = xx * yy - xy * xy
        scale = min(self.rule.correlated, count) / determinant
        floor_m2 = self.rule.systematic_of(extent / count) ** 2
        self.place[:, row] = (
            (yy * vx - xy * vy) / determinant, (xx * vy - xy * vx) / determinant,
            yy * scale + floor_m2, -xy * scale, xx * scale + floor_m2, variance / count,
        )  # fmt: skip


def agglomerated(places: Positions, pools: Sequence[ObservationPool]) -> list[list[int]]:
    """Rows that are one object: the closest two join first, until none may; what was seen in one frame never does.

    places: of these pools, row by row; consumed.
    """
    members = [[row] for row in range(len(pools))]
    row_of = {pool.key: row for row, pool in enumerate(pools)}
    beside = np.zeros((len(pools), len(pools)), dtype=bool)
    for row, pool in enumerate(pools):
        beside[row, [row_of[key] for key in pool.beside if key in row_of]] = True
    distance = np.where(beside, np.inf, places.distances(slice(None)))
    while len(pools) > 1:
        kept, gone = divmod(int(distance.argmin()), len(pools))
        if distance[kept, gone] == np.inf:
            break
        members[kept] += members[gone]
        members[gone] = []
        places.join(kept, gone)
        beside[kept] |= beside[gone]
        beside[:, kept] |= beside[:, gone]
        distance[gone] = distance[:, gone] = np.inf
        distance[kept] = distance[:, kept] = np.where(beside[kept], np.inf, places.distances(slice(kept, kept + 1))[0])
    return [rows for rows in members if rows]


class Estimate:
    """One object, fused from its pools: information-weighted mean of their places, plus what they all share.

    position_m: (2,) in the map frame. saved: the earlier map's object that is part of it, which shows whatever the
    evidence.
    """

    def __init__(self, pools: Sequence[ObservationPool], rule: AssociationRule) -> None:
        self.sums = SightingSums()
        for pool in pools:
            self.sums.join(pool.sums)
        self._pools, self._rule = pools, rule
        self.saved = next((pool.saved for pool in pools if pool.saved is not None), None)
        first = min(pools, key=lambda pool: (pool.saved is None, pool.sums.first_seen_s))
        self._first_m2 = first.first_m2
        known_m2 = mean_variance(first.first_m2)
        xx, xy, yy = np.array([pool.information for pool in pools]).T
        vx, vy = np.array([pool.vector for pool in pools]).T
        determinant = xx * yy - xy * xy
        x_m, y_m = (yy * vx - xy * vy) / determinant, (xx * vy - xy * vx) / determinant
        scale = np.minimum([float(pool.sums.count) for pool in pools], rule.correlated) / determinant
        drift_m2 = np.maximum(np.array([pool.variance_m2 for pool in pools]) - known_m2, 0.0)
        a, b, c = yy * scale + drift_m2, -xy * scale, xx * scale + drift_m2
        determinant = a * c - b * b
        xx, xy, yy = c / determinant, -b / determinant, a / determinant
        information = np.array([[xx.sum(), xy.sum()], [xy.sum(), yy.sum()]])
        self._spread_m2 = np.linalg.inv(information)
        self.position_m = self._spread_m2 @ [(xx * x_m + xy * y_m).sum(), (xy * x_m + yy * y_m).sum()]

    @property
    def shows(self) -> bool:
        """Whether there is enough evidence to put it on the map."""
        enough = self.sums.sure >= self._rule.min_count and self.sums.confidence >= self._rule.min_confidence
        return self.saved is not None or enough

    def covariance(self) -> Array:
        """(2, 2) m^2 in the map frame: own part, plus mount and first pose, which no number of sightings shrinks."""
        extent_m = sum(pool.extent_m * pool.sums.count for pool in self._pools) / self.sums.count
        shared = sum((pool.shared for pool in self._pools), np.zeros((2, 2))) / sum(p.weight for p in self._pools)
        own = self._spread_m2 + np.eye(2) * self._rule.systematic_of(extent_m) ** 2
        return own + shared + self._first_m2

    def as_object(self, identity: str, label: str) -> MapObject:
        """The object as a map shows it."""
        return self.sums.as_object(identity, label, self.position_m, self.covariance())
