"""A map as occupied, free and unknown cells of floor."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from edgemap.geometry.errors import MapError
from edgemap.geometry.grid.occupancy_grid import FREE, OCCUPIED, UNKNOWN, GridRule, OccupancyGrid
from edgemap.geometry.map_object import MapObject, reach_m
from edgemap.geometry.se2 import SE2
from edgemap.runtime.frames.trajectory import Trajectory

MAXIMUM_CELLS, MAXIMUM_LIVE_CELLS = 100_000_000, 1_000_000
MARGIN_M = 0.5  # unknown border around a map


@dataclass(frozen=True, slots=True, eq=False)
class FloorCells:
    """cells: (rows, columns) int8; row 0 has the smallest y, column 0 the smallest x, as in nav_msgs/OccupancyGrid.

    x_m, y_m: the outer corner of cell (0, 0) in the map frame. cell_m: side of a cell.
    """

    cells: NDArray[np.int8]
    x_m: float
    y_m: float
    cell_m: float


def grid_of(
    objects: Sequence[MapObject],
    trajectory: Trajectory | None = None,
    cell_m: float = GridRule().cell_m,
    robot_width_m: float = 0.35,
    observed: OccupancyGrid | None = None,
) -> FloorCells:
    """Objects occupied, the floor that the robot has driven over free, the rest unknown, or as observed in cells of the
    same size; objects win.

    cell_m: side of a cell. robot_width_m: width that the robot sweeps free along its path. Raises MapError where
    nothing is there to draw, or for more than 100 million cells.
    """
    swept_m = robot_width_m / 2.0
    path_m = np.array([(pose.x_m, pose.y_m) for pose in trajectory.poses] if trajectory else []).reshape(-1, 2)
    reach = [(item.position_m, reach_m(item) + MARGIN_M) for item in objects]
    reach += [(point, swept_m + MARGIN_M) for point in path_m]
    corners = [centre + sign * radius for centre, radius in reach for sign in (-1.0, 1.0)]
    if observed is not None:  # both lie on whole cells from the map's origin
        corner, shape = np.array([observed.x_m, observed.y_m]), observed.cells.shape
        corners += [corner + 0.5 * cell_m, corner + (np.array(shape[::-1]) - 0.5) * cell_m]
    if not corners:
        raise MapError("the map has neither objects nor a trajectory: there is no floor to draw")
    first = np.floor(np.min(corners, axis=0) / cell_m)  # whole cells, so that grids of one map fit onto each other
    columns, rows = (int(count) for count in np.ceil(np.max(corners, axis=0) / cell_m) - first)
    if rows * columns > MAXIMUM_CELLS:
        raise MapError(
            f"{columns} x {rows} cells of {cell_m:g} m: more than {MAXIMUM_CELLS}, take a coarser resolution"
        )
    x_m, y_m = (round(float(value) * cell_m, 9) for value in first)
    grid = FloorCells(np.full((rows, columns), UNKNOWN, np.int8), x_m, y_m, cell_m)
    if observed is not None:
        column, row = np.rint(corner / cell_m - first).astype(int)
        grid.cells[row : row + shape[0], column : column + shape[1]] = observed.cells
    if len(path_m):
        _sweep(grid, path_m, swept_m)
    for item in objects:
        _occupy(grid, item)
    return grid


def live_grid(objects: Sequence[MapObject], x_m: float, y_m: float) -> FloorCells:
    """The grid of `grid_of` with the floor below a robot at (x_m, y_m) free. The side of a cell is doubled until at
    most a million cells cover everything."""
    cell_m = GridRule().cell_m
    points = np.array([[x_m, y_m], *(item.position_m for item in objects)])
    sides_m = np.ptp(points, axis=0) + 2.0 * (MARGIN_M + max([reach_m(item) for item in objects], default=1.0))
    while float(np.prod(np.ceil(sides_m / cell_m) + 2.0)) > MAXIMUM_LIVE_CELLS:
        cell_m *= 2.0
    return grid_of(objects, Trajectory(np.zeros(1), (SE2(x_m, y_m),)), cell_m)


def _sweep(grid: FloorCells, path_m: NDArray[np.float64], radius_m: float) -> None:
    """Frees the cells whose centre is within a radius of the path, to half a cell."""
    res, at = grid.cell_m, np.floor((path_m - [grid.x_m, grid.y_m]) / grid.cell_m).astype(np.int32)
    around = math.ceil(radius_m / res) + 1
    (c0, r0), (c1, r1) = np.maximum(at.min(axis=0) - around, 0), at.max(axis=0) + around + 1
    part = grid.cells[r0:r1, c0:c1]
    off, at = np.ones(part.shape, np.uint8), at - np.array([c0, r0], np.int32)
    off[at[:, 1], at[:, 0]] = 0
    cv2.polylines(off, [at], False, 0)
    part[cv2.distanceTransform(off, cv2.DIST_L2, cv2.DIST_MASK_PRECISE) * res <= radius_m] = FREE


def _occupy(grid: FloorCells, item: MapObject) -> None:
    """Occupies the cells whose centre is within an object's footprint, and always the cell of its centre."""
    res, radius = grid.cell_m, reach_m(item) / grid.cell_m
    at = (item.position_m - [grid.x_m, grid.y_m]) / res
    c0, r0 = np.floor(at - radius).astype(int)
    c1, r1 = np.ceil(at + radius).astype(int)
    x, y = (np.arange(c0, c1) + 0.5 - at[0])[None, :], (np.arange(r0, r1) + 0.5 - at[1])[:, None]
    inside = x**2 + y**2 <= radius**2
    if (shape := item.footprint).yaw_rad is not None:
        cosine, sine = math.cos(shape.yaw_rad) * res, math.sin(shape.yaw_rad) * res
        along, across = cosine * x + sine * y, cosine * y - sine * x
        inside = (np.abs(along) <= shape.depth_m / 2.0) & (np.abs(across) <= shape.width_m / 2.0)
    grid.cells[r0:r1, c0:c1][inside] = OCCUPIED
    grid.cells[int(at[1]), int(at[0])] = OCCUPIED
