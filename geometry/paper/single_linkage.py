"""The paper's clustering, exact and online: single linkage per label at a fixed distance.

Single linkage cut at d is the connected components of the graph that joins points at most d apart, so it does not
depend on the order of the points. Points are kept in square cells whose diagonal is d: all points of a cell belong
together, and a point is forgotten once the discs of radius d around its cell mates cover its own disc, because then
no later point can join the cluster through it alone. Memory follows the floor area and not time.
"""

import math
from dataclasses import dataclass, field

import numpy as np

from edgemap.geometry.arrays import Array

_QUANTUM_M = 1e-9  # sums are integers of this unit, hence the same in any order


@dataclass(slots=True)
class _Cell:
    """Points within one square that can still join something new."""

    kept: list[tuple[float, float]] = field(default_factory=list)


class SingleLinkage:
    """Connected components of points at most `threshold_m` apart, updated point by point.

    joined: the merges that the last point caused, as (remaining cluster, removed cluster), in order. Raises ValueError
    for a threshold that is not positive.
    """

    def __init__(self, threshold_m: float = 1.0) -> None:
        if not threshold_m > 0:
            raise ValueError(f"threshold is {threshold_m} m, must be positive")
        self.threshold_m = threshold_m
        self._side = threshold_m / math.sqrt(2.0) * (1.0 - 1e-12)
        self._cells: dict[tuple[int, int], _Cell] = {}
        self._parent: dict[tuple[int, int], tuple[int, int]] = {}
        self._totals: dict[tuple[int, int], list[int]] = {}
        self.joined: list[tuple[tuple[int, int], tuple[int, int]]] = []

    def add(self, x_m: float, y_m: float) -> tuple[int, int]:
        """Add a point; the cluster that it belongs to now."""
        self.joined = []
        key = (math.floor(x_m / self._side), math.floor(y_m / self._side))
        cell = self._cells.get(key)
        if cell is None:
            cell = self._cells[key] = _Cell()
            self._parent[key] = key
            self._totals[key] = [0, 0, 0]
        if not _covered((x_m, y_m), cell.kept, self.threshold_m):
            self._join_neighbours(key, x_m, y_m)
            cell.kept.append((x_m, y_m))
            cell.kept = _without_covered(cell.kept, self.threshold_m)
        root = self.cluster_of(key)
        total = self._totals[root]
        total[0] += round(x_m / _QUANTUM_M)
        total[1] += round(y_m / _QUANTUM_M)
        total[2] += 1
        return root

    def cluster_of(self, key: tuple[int, int]) -> tuple[int, int]:
        """The current cluster of a cell or of a merged cluster."""
        while self._parent[key] != key:
            self._parent[key] = self._parent[self._parent[key]]
            key = self._parent[key]
        return key

    def centres(self) -> dict[tuple[int, int], tuple[Array, int]]:
        """Mean position (2,) in metres and number of points of each cluster, independent of the points' order."""
        return {
            root: (np.array([x / count * _QUANTUM_M, y / count * _QUANTUM_M]), count)
            for root, (x, y, count) in self._totals.items()
        }

    def _join_neighbours(self, key: tuple[int, int], x_m: float, y_m: float) -> None:
        reach2 = self.threshold_m**2
        for i in range(key[0] - 2, key[0] + 3):
            for j in range(key[1] - 2, key[1] + 3):
                other = self._cells.get((i, j))
                if other is None or (i, j) == key:
                    continue
                if any((x_m - x) ** 2 + (y_m - y) ** 2 <= reach2 for x, y in other.kept):
                    self._union(key, (i, j))

    def _union(self, a: tuple[int, int], b: tuple[int, int]) -> None:
        root_a, root_b = self.cluster_of(a), self.cluster_of(b)
        if root_a != root_b:
            low, high = min(root_a, root_b), max(root_a, root_b)
            self._parent[high] = low
            gone = self._totals.pop(high)
            self._totals[low] = [a + b for a, b in zip(self._totals[low], gone, strict=True)]
            self.joined.append((low, high))


def _covered(point: tuple[float, float], others: list[tuple[float, float]], radius: float) -> bool:
    """Whether discs around `others`, each within `radius` of the point, cover the disc around the point.

    They do exactly when they cover its rim: disc k holds both the point and a rim point, hence what lies between.
    The rim within disc k is an arc of half-width acos(r / 2 radius) towards k, where r is the distance to k.
    """
    arcs = []
    for x, y in others:
        dx, dy = x - point[0], y - point[1]
        r = math.hypot(dx, dy)
        if r < 1e-12:
            return True
        half = math.acos(min(r / (2.0 * radius), 1.0)) - 1e-9
        start = (math.atan2(dy, dx) - half) % math.tau
        arcs.append((start, start + 2.0 * half))
    if len(arcs) < 2:
        return False
    arcs.sort()
    reach = first = arcs[0][0]
    for start, end in arcs + [(start + math.tau, end + math.tau) for start, end in arcs]:
        if start > reach and reach < first + math.tau:
            return False
        reach = max(reach, end)
    return reach >= first + math.tau


def _without_covered(points: list[tuple[float, float]], radius: float) -> list[tuple[float, float]]:
    kept = list(points)
    for point in points[:-1]:
        rest = [other for other in kept if other is not point]
        if _covered(point, rest, radius):
            kept = rest
    return kept
