"""An immutable occupancy grid: log-odds of each cell, and the cell states derived from them."""

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.ndimage import binary_dilation

from edgemap.geometry.arrays import Array

FREE, OCCUPIED, UNKNOWN = 0, 100, -1  # as in nav_msgs/OccupancyGrid
BESIDE_M = 0.15  # maximum distance of an occupied cell to a free one
STEPS = 16  # log-odds are saved in sixteenths, 8 bits


@dataclass(frozen=True, slots=True)
class GridRule:
    """Inverse sensor model of the grid. Log-odds are natural logarithms; m is metres in the map. A radian of rotation
    counts as a metre of path.
    """

    cell_m: float = 0.05  # side of a cell
    reach_m: float = 4.0  # greatest range of picture and depth: farther off, a row of the mask covers too much floor
    # Floor per row of the mask up to which evidence has full weight; beyond, the weight is inversely proportional.
    row_m: float = 0.06
    floor: float = 0.8  # probability from which a cell of the mask is floor
    run: int = 3  # least rows of floor below a contact; fewer are reflections and gaps between legs
    free: float = 0.3  # log-odds of one picture near by
    occupied: float = 1.05  # log-odds of one picture near by
    # Bound of a cell's log-odds, for and against: an occupied cell becomes free after (highest + 1.1) / free pictures.
    highest: float = 2.5
    robot_m: float = 0.18  # radius round the base that the robot itself keeps free
    scan_m: float = 0.10  # path after which the next picture is fused, as errors repeat at one place
    scan_s: float = 0.4  # time after which the next picture is fused
    patch_m: float = 0.75  # path after which a new patch begins; patches move with the trajectory
    obstacle_m: float = 0.06  # height above the floor from which a depth measurement is an obstacle
    obstacle_per_m: float = 0.02  # added to obstacle_m per metre of distance (1.1 degrees of attitude)
    robot_height_m: float = 0.5  # height up to which it is one, or up to the lens where that is higher


@dataclass(frozen=True, eq=False)
class OccupancyGrid:
    """log_odds: (rows, columns) int8, in sixteenths, 0 where unknown; row 0 has the smallest y, column 0 the smallest
    x, as in nav_msgs/OccupancyGrid. x_m, y_m: outer corner of cell (0, 0) in the map frame, a whole number of cells
    from its origin. revision: increases with every change within a run.
    """

    log_odds: NDArray[np.int8]
    x_m: float
    y_m: float
    cell_m: float
    free_below: float = math.log(0.25 / 0.75)  # log-odds of the thresholds of Nav2's map_saver
    occupied_above: float = math.log(0.65 / 0.35)
    revision: int = 0

    @cached_property
    def cells(self) -> NDArray[np.int8]:
        """State of each cell, (rows, columns): FREE, OCCUPIED or UNKNOWN.

        A cell is OCCUPIED only if a free cell lies within `BESIDE_M`, because the free floor ends at an obstacle.
        Other cells with occupied log-odds stay UNKNOWN: there, the contact with the floor was placed too far away.
        """
        cells = np.full(self.log_odds.shape, UNKNOWN, np.int8)
        free = self.log_odds < self.free_below * STEPS
        reach = max(round(BESIDE_M / self.cell_m), 1)
        adjacent = np.asarray(binary_dilation(free, np.ones((3, 3), np.bool_), reach), dtype=np.bool_)
        cells[free] = FREE
        cells[adjacent & (self.log_odds > self.occupied_above * STEPS)] = OCCUPIED
        cells.setflags(write=False)
        return cells

    def centres_m(self, mask: NDArray[np.bool_]) -> Array:
        """Centres (N, 2), map frame, metres, of the cells that a mask (rows, columns) selects."""
        rows, columns = np.nonzero(mask)
        corner = np.array([self.x_m, self.y_m], dtype=np.float64)
        return np.column_stack([columns + 0.5, rows + 0.5]).astype(np.float64) * self.cell_m + corner

    def at(self, points_m: ArrayLike) -> NDArray[np.int8]:
        """Cell states (N,) at points (N, 2), map frame, metres; UNKNOWN outside the grid."""
        return self._values(self.cells, points_m, UNKNOWN)

    def occupancy(self, points_m: ArrayLike) -> Array:
        """Probability (N,) that something stands at points (N, 2), map frame, metres; a half where unknown."""
        return 1.0 / (1.0 + np.exp(self._values(self.log_odds, points_m, 0) / -STEPS))

    def _values(self, array: NDArray[np.int8], points_m: ArrayLike, outside: int) -> NDArray[np.int8]:
        points = np.asarray(points_m, dtype=np.float64).reshape(-1, 2)
        columns, rows = np.floor((points - [self.x_m, self.y_m]) / self.cell_m).astype(np.intp).T
        inside = (rows >= 0) & (columns >= 0) & (rows < array.shape[0]) & (columns < array.shape[1])
        values = np.full(len(points), outside, np.int8)
        values[inside] = array[rows[inside], columns[inside]]
        return values

    def scaled(self, factor: float) -> "OccupancyGrid":
        """The grid times `factor` about the map's origin, in cells of the same size: each takes the nearest old one."""
        low, shape = np.array([self.x_m, self.y_m]) / self.cell_m, np.array(self.log_odds.shape[::-1])
        first = np.floor(low * factor + 1e-6).astype(int)
        last = np.ceil((low + shape) * factor - 1e-6).astype(int)
        columns, rows = (
            np.clip(np.floor((np.arange(start, end) + 0.5) / factor - old + 1e-9).astype(int), 0, count - 1)
            for start, end, old, count in zip(first, last, low, shape, strict=True)
        )
        x_m, y_m = (first * self.cell_m).tolist()
        return replace(self, log_odds=self.log_odds[np.ix_(rows, columns)], x_m=x_m, y_m=y_m)
