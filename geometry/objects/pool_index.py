"""Observation pools of one label by where they are: rows of arrays, a grid of cells, links between neighbours."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from itertools import combinations
from typing import Any

import numpy as np

from edgemap.geometry.arrays import Array
from edgemap.geometry.objects.association import AssociationRule
from edgemap.geometry.objects.observation_pool import Key, ObservationPool


class PoolIndex:
    """pools: by row, None where a row is free. links: rows that each may join. Arrays grow by doubling; an update costs
    what lies around it, not what lies elsewhere.

    sums (8, N): information xx, xy, yy; vector x, y; count; extent and pose variance, each times count. place (7, N): x
    and y in m, the own covariance's xx, xy, yy and the pose's mean variance in m^2, the landmark.
    """

    def __init__(self, rule: AssociationRule) -> None:
        self.rule = rule
        self.pools: list[ObservationPool | None] = []
        self.row_of: dict[Key, int] = {}
        self.links: list[set[int]] = []
        self.sums, self.place = np.zeros((8, 8)), np.full((7, 8), np.nan)
        self._cells: dict[tuple[int, int], dict[int, None]] = {}
        self._cell: list[tuple[int, int] | None] = []
        self._free: list[int] = []

    def __len__(self) -> int:
        return len(self.row_of)

    def add(self, pool: ObservationPool) -> int:
        """A row for one more pool."""
        row = self._free.pop() if self._free else len(self.pools)
        if row == len(self.pools):
            self.pools.append(None)
            self.links.append(set())
            self._cell.append(None)
            if row == self.sums.shape[1]:
                self.sums = np.concatenate([self.sums, np.zeros_like(self.sums)], axis=1)
                self.place = np.concatenate([self.place, np.full_like(self.place, np.nan)], axis=1)
        self.pools[row], self.row_of[pool.key], pool.row = pool, row, row
        self.set(row)
        return row

    def set(self, row: int) -> None:
        """Take note that a pool has changed."""
        pool = self.pool(row)
        count = float(pool.sums.count)
        self.sums[:, row] = (*pool.information, *pool.vector, count, pool.extent_m * count, pool.variance_m2 * count)
        self.place[:, row] = *placed(self.sums[:, row].tolist(), self.rule), pool.landmark
        x_m, y_m = self.place[:2, row]
        cell = self._cell_at(x_m, y_m)
        if cell != self._cell[row]:
            self._leave_cell(row)
            self._cells.setdefault(cell, {})[row] = None
            self._cell[row] = cell

    def pool(self, row: int) -> ObservationPool:
        """The pool of a row that is not free."""
        pool = self.pools[row]
        assert pool is not None
        return pool

    def remove(self, row: int) -> None:
        """Free a row; nothing refers to its pool from then on."""
        pool = self.pool(row)
        for other in pool.beside:
            other.beside.pop(pool, None)
        for other in self.links[row]:
            self.links[other].discard(row)
        self._leave_cell(row)
        del self.row_of[pool.key]
        self.pools[row], self.links[row], self.place[:, row] = None, set(), np.nan
        self._free.append(row)

    def join(self, kept: int, gone: int) -> None:
        """Two pools become one, which keeps the first one's key."""
        pool, other = self.pool(kept), self.pool(gone)
        neighbours = [item for item in other.beside if item is not pool]
        pool.join(other)
        self.remove(gone)
        for item in neighbours:
            item.beside[pool] = pool.beside[item] = None
        self.set(kept)
        self.link(kept)

    def link(self, row: int) -> bool:
        """Find again what a pool may join; whether that is something else than before."""
        x_m, y_m = self.place[:2, row]
        i, j = self._cell_at(x_m, y_m)
        near = [other for a in (i - 1, i, i + 1) for b in (j - 1, j, j + 1) for other in self._cells.get((a, b), ())]
        pool, here = self.pool(row), self.place[:, row].tolist()
        now = {
            other
            for other in near
            if other != row
            and _joins(here, self.place[:, other].tolist(), self.rule)
            and not pool.is_apart(self.pool(other))
        }
        for other in self.links[row] - now:
            self.links[other].discard(row)
        for other in now - self.links[row]:
            self.links[other].add(row)
        before, self.links[row] = self.links[row], now
        return now != before

    def connected(self, rows: Iterable[int]) -> set[int]:
        """Rows that these are linked with, directly or through others."""
        found, new = set(rows), set(rows)
        while new:
            new = set[int]().union(*(self.links[row] for row in new)) - found
            found |= new
        return found

    def agglomerated(self, rows: Sequence[int]) -> list[list[int]]:
        """Rows that are one object: the closest two join first, until none may; what was seen in one frame never
        does."""
        pools, places = [self.pool(row) for row in rows], self.place[:, rows].T.tolist()
        pairs = combinations(zip(pools, places, strict=True), 2)
        if all(_joins(a, b, self.rule) and not pool.is_apart(other) for (pool, a), (other, b) in pairs):
            return [list(rows)]
        if len(rows) == 2:
            return [[row] for row in rows]
        sums, place = self.sums[:, rows].copy(), self.place[:, rows].copy()
        members = [[row] for row in rows]
        at = {pool: number for number, pool in enumerate(pools)}
        beside = np.eye(len(rows), dtype=bool)
        for pool, number in at.items():
            beside[number, [at[other] for other in pool.beside if other in at]] = True
        saved = [number for pool, number in at.items() if pool.saved is not None]
        beside[np.ix_(saved, saved)] = True
        distance = np.where(beside, np.inf, distances(place, place, self.rule))
        while True:
            kept, gone = divmod(int(distance.argmin()), len(rows))
            if distance[kept, gone] == np.inf:
                return [group for group in members if group]
            members[kept] += members[gone]
            members[gone] = []
            sums[:, kept] += sums[:, gone]
            place[:6, kept] = placed(sums[:, kept].tolist(), self.rule)
            place[6, kept] = max(place[6, kept], place[6, gone])
            beside[kept] |= beside[gone]
            beside[:, kept] |= beside[:, gone]
            distance[gone] = distance[:, gone] = np.inf
            own = distances(place[:, [kept]], place, self.rule)[0]
            gone_rows = [number for number, group in enumerate(members) if not group]
            own[gone_rows] = np.inf
            distance[kept] = distance[:, kept] = np.where(beside[kept], np.inf, own)

    def _cell_at(self, x_m: float, y_m: float) -> tuple[int, int]:
        return math.floor(x_m / self.rule.max_distance_m), math.floor(y_m / self.rule.max_distance_m)

    def _leave_cell(self, row: int) -> None:
        cell, self._cell[row] = self._cell[row], None
        if cell is not None:
            del self._cells[cell][row]
            if not self._cells[cell]:
                del self._cells[cell]


def placed(sums: Sequence[float], rule: AssociationRule) -> tuple[float, ...]:
    """Position, own covariance and pose variance from a row's sums."""
    xx, xy, yy, vx, vy, count, extent, variance = sums
    determinant = xx * yy - xy * xy
    scale = min(rule.correlated, count) / determinant
    floor_m2 = rule.systematic_of(extent / count) ** 2
    return (
        (yy * vx - xy * vy) / determinant, (xx * vy - xy * vx) / determinant,
        yy * scale + floor_m2, -xy * scale, xx * scale + floor_m2, variance / count,
    )  # fmt: skip


def distances(here: Array, there: Array, rule: AssociationRule) -> Array:
    """Squared Mahalanobis distances of M places (7, M) to N, (M, N): under both own covariances and what the pose
    drifted between the two, zero for one landmark; infinite beyond the gate and the greatest distance."""
    here, there = here[:, :, None], there[:, None, :]
    found, apart_m2 = _squared(here, there)
    found = np.where((here[6] == there[6]) & (here[6] >= 0.0), 0.0, found)
    near = (found <= rule.gate) & (apart_m2 <= rule.max_distance_m**2)
    return np.where(near, found, np.inf)


def _joins(here: Sequence[float], there: Sequence[float], rule: AssociationRule) -> bool:
    """Whether two places are a finite distance apart: of a few, one by one is ten times as fast as an array."""
    found, apart_m2 = _squared(here, there)
    one_landmark = here[6] == there[6] and here[6] >= 0.0
    return apart_m2 <= rule.max_distance_m**2 and (one_landmark or found <= rule.gate)


def _squared(here: Any, there: Any) -> tuple[Any, Any]:
    """Squared distances of places, numbers or arrays: of Mahalanobis, and in m^2."""
    dx, dy = there[0] - here[0], there[1] - here[1]
    drift_m2 = abs(there[5] - here[5])
    xx, xy, yy = here[2] + there[2] + drift_m2, here[3] + there[3], here[4] + there[4] + drift_m2
    return (yy * dx * dx - 2.0 * xy * dx * dy + xx * dy * dy) / (xx * yy - xy * xy), dx * dx + dy * dy
