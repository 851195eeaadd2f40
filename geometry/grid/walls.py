"""Walls: straight segments that the occupied cells of a grid lie on, detected by a Hough transform."""

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation

from edgemap.geometry.arrays import Array
from edgemap.geometry.grid.occupancy_grid import FREE, OCCUPIED, OccupancyGrid

SHORTEST_M = 0.8  # of a wall: the edge of a chair or a shelf is shorter
FILLED = 0.6  # least share of a wall's length that has a cell
# Distance of a wall's cells from its line, as an edge observed from two sides is a band of two cells; so far the ends
# of the shortest wall move between two directions that are tried in turn, and a wall bends beside a cut between rooms.
ASIDE_CELLS = 2
MOST = 60  # walls of a grid, which bounds the work

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


@lru_cache(maxsize=2)
def walls_of(grid: OccupancyGrid) -> tuple[Wall, ...]:
    """The walls of a grid, where free floor ends; computed once per grid."""
    beside_floor = binary_dilation(grid.cells == FREE, np.ones((3, 3), np.bool_))
    return fit_walls(grid.centres_m((grid.cells == OCCUPIED) & beside_floor), grid.cell_m)


def fit_walls(points_m: Array, cell_m: float) -> tuple[Wall, ...]:
    """Segments through points (N, 2), one for each occupied cell: the line with most votes first, its longest parts
    taken, their points left out of all later lines."""
    walls: list[Wall] = []
    if len(points_m) < (fewest := _fewest(cell_m)):
        return ()
    angles = np.arange(0.0, math.pi, _step_rad(cell_m))
    normals = np.column_stack([np.cos(angles), np.sin(angles)])
    offsets = np.rint(points_m @ normals.T / cell_m).astype(np.int64)
    low = int(offsets.min())
    bins = offsets - low + np.arange(len(angles)) * (width := int(offsets.max()) - low + 1)
    votes = np.bincount(bins.ravel(), minlength=width * len(angles)).astype(np.int64)
    left = np.ones(len(points_m), np.bool_)
    for _ in range(2 * MOST):
        at = int(votes.argmax())
        if votes[at] < fewest or len(walls) >= MOST:
            break
        angle, offset = divmod(at, width)
        parts = _parts(points_m, left, normals[angle], (offset + low) * cell_m, cell_m)
        for wall, taken in parts:
            walls.append(wall)
            left[taken] = False
            np.subtract.at(votes, bins[taken].ravel(), 1)
        if not parts:
            votes[at] = 0
    return tuple(sorted(walls, key=lambda wall: -wall.length_m))


def _fewest(cell_m: float) -> int:
    """Cells of the shortest wall."""
    return round(FILLED * SHORTEST_M / cell_m)


def _step_rad(cell_m: float) -> float:
    """Between two directions that are tried."""
    return ASIDE_CELLS * cell_m / SHORTEST_M


def _parts(
    points: Array, left: NDArray[np.bool_], normal: Array, offset_m: float, cell_m: float
) -> list[tuple[Wall, NDArray[np.intp]]]:
    """The long parts of one line, each with its points' rows; the line is fitted to its points first."""
    aside_m = ASIDE_CELLS * cell_m
    for _ in range(2):
        inliers = np.flatnonzero(left & (np.abs(points @ normal - offset_m) <= aside_m))
        if len(inliers) < _fewest(cell_m):
            return []
        middle = points[inliers].mean(axis=0)
        offsets = points[inliers] - middle
        vector = np.linalg.eigh(offsets.T @ offsets)[1][:, 0]
        if abs(vector @ normal) < math.cos(3.0 * _step_rad(cell_m)):
            break
        normal, offset_m = vector, float(vector @ middle)
    along = np.array([-normal[1], normal[0]])
    place = points @ along
    inliers = np.flatnonzero(left & (np.abs(points @ normal - offset_m) <= aside_m))
    inliers = inliers[np.argsort(place[inliers], kind="stable")]
    parts, gap_m = [], (1.0 - FILLED) * SHORTEST_M  # that the shortest wall may have: by a lamp, not by a doorway
    for run in np.split(inliers, np.flatnonzero(np.diff(place[inliers]) > gap_m) + 1):
        if not len(run):
            continue
        first, last = float(place[run[0]]) - cell_m / 2.0, float(place[run[-1]]) + cell_m / 2.0
        filled = np.count_nonzero(np.bincount(np.floor((place[run] - first) / cell_m).astype(np.intp))) * cell_m
        if last - first < SHORTEST_M or filled < FILLED * (last - first):
            continue
        across = float(np.mean(points[run] @ normal))
        (x0, y0), (x1, y1) = (tuple((across * normal + at * along).tolist()) for at in (first, last))
        parts.append((Wall((x0, y0), (x1, y1)), run))
    return parts
