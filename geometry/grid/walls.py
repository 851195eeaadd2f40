"""Walls: straight segments that the occupied cells of a grid lie on, found by a Hough transform."""

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation

from edgemap.geometry.arrays import Array
from edgemap.geometry.grid.occupancy_grid import FREE, OCCUPIED, OccupancyGrid

Point = tuple[float, float]


@dataclass(frozen=True, slots=True)
class Wall:
    """A straight segment of the floor plan, map frame, metres."""

    from_m: Point
    to_m: Point

    @property
    def length_m(self) -> float:
        """Length, m."""
        return math.dist(self.from_m, self.to_m)


@dataclass(frozen=True, slots=True)
class WallRule:
    """shortest_m: least length of a wall; a chair's or a shelf's edge is shorter. aside_m: greatest distance of its
    cells from the line: an edge observed from two sides is a band of two cells. gap_m: greatest gap between two of its
    cells: a lamp in front of a wall does not split it, a doorway does. filled: least share of its length that has a
    cell. beside_m: distance from a wall within which there is no other, since contacts of one edge scatter. step_rad:
    of the accumulator. most: greatest number of walls.
    """

    shortest_m: float = 0.8
    aside_m: float = 0.09
    gap_m: float = 0.35
    filled: float = 0.6
    beside_m: float = 0.2
    step_rad: float = math.radians(2.0)
    most: int = 60

    def fewest(self, cell_m: float) -> int:
        """Cells of the shortest wall."""
        return round(self.filled * self.shortest_m / cell_m)


@lru_cache(maxsize=4)
def walls_of(grid: OccupancyGrid) -> tuple[Wall, ...]:
    """The walls of a grid by the default rule, where free floor ends; computed once per grid."""
    beside_floor = binary_dilation(grid.cells == FREE, np.ones((3, 3), np.bool_))
    return fit_walls(grid.centres_m((grid.cells == OCCUPIED) & beside_floor), grid.cell_m)


def fit_walls(points_m: Array, cell_m: float, rule: WallRule | None = None) -> tuple[Wall, ...]:
    """Segments through points (N, 2), one for each occupied cell: the line with most votes first, its longest parts
    taken, their points left out of all later lines."""
    rule = rule or WallRule()
    found: list[Wall] = []
    if len(points_m) < (fewest := rule.fewest(cell_m)):
        return ()
    angles = np.arange(0.0, math.pi, rule.step_rad)
    normals = np.column_stack([np.cos(angles), np.sin(angles)])
    offsets = np.rint(points_m @ normals.T / cell_m).astype(np.int64)
    low = int(offsets.min())
    bins = offsets - low + np.arange(len(angles)) * (width := int(offsets.max()) - low + 1)
    votes = np.bincount(bins.ravel(), minlength=width * len(angles)).astype(np.int64)
    left = np.ones(len(points_m), np.bool_)
    for _ in range(2 * rule.most):
        at = int(votes.argmax())
        if votes[at] < fewest or len(found) >= rule.most:
            break
        angle, offset = divmod(at, width)
        parts = _parts(points_m, left, normals[angle], (offset + low) * cell_m, cell_m, rule)
        taken = np.concatenate([own for _, own in parts]) if parts else np.zeros(0, np.intp)
        found += [wall for wall, _ in parts]
        if len(taken):
            left[taken] = False
            np.subtract.at(votes, bins[taken].ravel(), 1)
        else:
            votes[at] = 0
    return tuple(sorted(found, key=lambda wall: -wall.length_m))


def _parts(
    points: Array, left: NDArray[np.bool_], normal: Array, offset_m: float, cell_m: float, rule: WallRule
) -> list[tuple[Wall, NDArray[np.intp]]]:
    """The long parts of one line, each with its points' rows; the line is fitted to its points first."""
    for _ in range(2):
        own = np.flatnonzero(left & (np.abs(points @ normal - offset_m) <= rule.aside_m))
        if len(own) < rule.fewest(cell_m):
            return []
        middle = points[own].mean(axis=0)
        apart = points[own] - middle
        vector = np.linalg.eigh(apart.T @ apart)[1][:, 0]
        if abs(vector @ normal) < math.cos(3.0 * rule.step_rad):
            break
        normal, offset_m = vector, float(vector @ middle)
    along = np.array([-normal[1], normal[0]])
    away, place = np.abs(points @ normal - offset_m), points @ along
    own = np.flatnonzero(left & (away <= rule.aside_m))
    own = own[np.argsort(place[own], kind="stable")]
    parts = []
    for run in np.split(own, np.flatnonzero(np.diff(place[own]) > rule.gap_m) + 1):
        if not len(run):
            continue
        first, last = float(place[run[0]]) - cell_m / 2.0, float(place[run[-1]]) + cell_m / 2.0
        filled = np.count_nonzero(np.bincount(np.floor((place[run] - first) / cell_m).astype(np.intp))) * cell_m
        if last - first < rule.shortest_m or filled < rule.filled * (last - first):
            continue
        across = float(np.mean(points[run] @ normal))
        (x0, y0), (x1, y1) = (tuple((across * normal + at * along).tolist()) for at in (first, last))
        beside = left & (away <= rule.beside_m) & (place >= first) & (place <= last)
        parts.append((Wall((x0, y0), (x1, y1)), np.flatnonzero(beside)))
    return parts
