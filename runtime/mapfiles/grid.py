"""A map as occupied, free and unknown cells of floor."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from edgemap.geometry.errors import MapError
from edgemap.geometry.objects.map_object import MapObject, radius_m
from edgemap.geometry.se2 import SE2
from edgemap.runtime.trajectory import Trajectory

FREE, OCCUPIED, UNKNOWN = 0, 100, -1  # as in nav_msgs/OccupancyGrid
MAXIMUM_CELLS, MAXIMUM_LIVE_CELLS = 100_000_000, 1_000_000


@dataclass(frozen=True, slots=True, eq=False)
class Grid:
    """cells: (rows, columns) int8; row 0 has the smallest y, column 0 the smallest x, as in nav_msgs/OccupancyGrid.

    x_m, y_m: the outer corner of cell (0, 0) in the map frame.
    """

    cells: NDArray[np.int8]
    x_m: float
    y_m: float
    resolution_m: float


@dataclass(frozen=True, slots=True)
class GridRule:
    """resolution_m: side of a cell. robot_width_m: what the robot sweeps free on its way. margin_m: unknown floor kept
    round everything."""

    resolution_m: float = 0.05
    robot_width_m: float = 0.35
    margin_m: float = 0.5


def grid_of(objects: Sequence[MapObject], trajectory: Trajectory | None = None, rule: GridRule | None = None) -> Grid:
    """Objects occupied, the floor that the robot has driven over free, the rest unknown; objects win.

    Raises MapError where nothing is there to draw, or for more than 100 million cells.
    """
    rule = rule or GridRule()
    discs = [(item.position_m, radius_m(item)) for item in objects]
    trail = [(point, rule.robot_width_m / 2.0) for point in _points(trajectory, rule.resolution_m / 2.0)]
    if not discs and not trail:
        raise MapError("the map has neither objects nor a trajectory: there is no floor to draw")
    res = rule.resolution_m
    low = np.min([np.asarray(centre) - radius for centre, radius in discs + trail], axis=0) - rule.margin_m
    high = np.max([np.asarray(centre) + radius for centre, radius in discs + trail], axis=0) + rule.margin_m
    first = np.floor(low / res)  # whole cells from the map's origin, so that grids of one map fit onto each other
    columns, rows = (np.ceil(high / res) - first).astype(int)
    if rows * columns > MAXIMUM_CELLS:
        raise MapError(f"{columns} x {rows} cells of {res:g} m: more than {MAXIMUM_CELLS}, take a coarser resolution")
    grid = Grid(np.full((rows, columns), UNKNOWN, np.int8), round(first[0] * res, 9), round(first[1] * res, 9), res)
    for value, some in ((FREE, trail), (OCCUPIED, discs)):
        for centre, radius in some:
            _fill(grid, np.asarray(centre), radius, value)
    return grid


def live_grid(objects: Sequence[MapObject], x_m: float, y_m: float) -> Grid:
    """As `grid_of` for a robot at (x_m, y_m): the floor that it stands on is free. Cells are twice as long, and twice
    again, until no more than a million cover everything."""
    rule = GridRule()
    here = Trajectory(np.zeros(1), (SE2(x_m, y_m),))
    points = np.array([[x_m, y_m], *(item.position_m for item in objects)])
    sides_m = np.ptp(points, axis=0) + 2.0 * (rule.margin_m + max([radius_m(item) for item in objects], default=1.0))
    while float(np.prod(np.ceil(sides_m / rule.resolution_m) + 2.0)) > MAXIMUM_LIVE_CELLS:
        rule = replace(rule, resolution_m=2.0 * rule.resolution_m)
    return grid_of(objects, here, rule)


def _fill(grid: Grid, centre_m: NDArray[np.float64], radius: float, value: int) -> None:
    """Set the cells whose middle lies within a disc, and at least the one that holds its centre."""
    res = grid.resolution_m
    at = (centre_m - [grid.x_m, grid.y_m]) / res
    c0, r0 = np.floor(at - radius / res).astype(int)
    c1, r1 = np.ceil(at + radius / res).astype(int)
    x = np.arange(c0, c1) + 0.5 - at[0]
    y = np.arange(r0, r1) + 0.5 - at[1]
    inside = x[None, :] ** 2 + y[:, None] ** 2 <= (radius / res) ** 2
    grid.cells[r0:r1, c0:c1][inside] = value
    grid.cells[int(at[1]), int(at[0])] = value


def _points(trajectory: Trajectory | None, step_m: float) -> list[tuple[float, float]]:
    """Points along the path, no farther than a step apart."""
    if trajectory is None:
        return []
    points = [(trajectory.poses[0].x_m, trajectory.poses[0].y_m)]
    for pose in trajectory.poses[1:]:
        x, y = points[-1]
        length = math.hypot(pose.x_m - x, pose.y_m - y)
        if length >= step_m:
            count = math.ceil(length / step_m)
            points += [(x + (pose.x_m - x) * k / count, y + (pose.y_m - y) * k / count) for k in range(1, count + 1)]
    return points
