"""The home from above on a grid: how high things stand, whose they are, and how far it is to the nearest of them."""

import math

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt, map_coordinates

from edgemap.simulation.apartment.apartment import Apartment, Placed
from edgemap.simulation.render.mesh import Array

CELL_M = 0.04
WALL_ID = -1
# What hangs higher than this neither stops the robot nor hides furniture.
_OVERHEAD_M = 1.3
# What hangs at least this high lets the robot pass below (no table does: its legs stand on the floor).
_PASS_M = 0.6


class PlanGrid:
    """A home seen from above. Cell (row, column) is centred at x = (column + 0.5) CELL_M, y likewise by row.

    tops_m: height of the highest thing at each cell, 0 on free floor, infinite in walls. owner: the id of that thing,
    0 for none, WALL_ID for walls.
    """

    def __init__(self, apartment: Apartment) -> None:
        plan = apartment.plan
        self.size_m = np.array([plan.width_m, plan.depth_m])
        columns, rows = (math.ceil(side / CELL_M) for side in self.size_m)
        x, y = np.meshgrid((np.arange(columns) + 0.5) * CELL_M, (np.arange(rows) + 0.5) * CELL_M)
        self._centres = np.stack([x, y], axis=-1)
        self.tops_m = np.zeros((rows, columns), dtype=np.float32)
        self.owner = np.zeros((rows, columns), dtype=np.int32)
        blocked = np.zeros((rows, columns), dtype=bool)
        for item in apartment.furniture:
            if item.z_m > _OVERHEAD_M:
                continue
            inside, top = self._covered(item), item.z_m + item.model.height_m
            higher = inside & (self.tops_m < top)
            self.tops_m[higher], self.owner[higher] = top, item.id
            if item.z_m < _PASS_M:
                blocked |= inside
        for x0, y0, x1, y1 in plan.walls:
            wall = (x > x0) & (x < x1) & (y > y0) & (y < y1)
            self.tops_m[wall], self.owner[wall] = np.inf, WALL_ID
            blocked |= wall
        blocked[[0, -1]] = blocked[:, [0, -1]] = True
        self._distance_m = np.asarray(distance_transform_edt(~blocked), dtype=np.float64) * CELL_M

    def clearance_m(self, points_m: Array) -> Array:
        """Distances (N,) from points (N, 2) to the nearest wall or furniture; 0 outside. Good to half a cell."""
        points = np.asarray(points_m, dtype=np.float64).reshape(-1, 2)
        cells = points[:, ::-1].T / CELL_M - 0.5
        return np.asarray(map_coordinates(self._distance_m, cells, order=1, mode="constant", cval=0.0))

    def cells_of(self, points_m: Array) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Rows and columns of points (..., 2), those outside at the border."""
        rows, columns = self.tops_m.shape
        row = np.clip((points_m[..., 1] / CELL_M).astype(np.int64), 0, rows - 1)
        return row, np.clip((points_m[..., 0] / CELL_M).astype(np.int64), 0, columns - 1)

    def _covered(self, item: Placed) -> NDArray[np.bool_]:
        local = np.abs(item.pose_home_object.inverse().apply(self._centres))
        return np.asarray((local <= [item.model.depth_m / 2.0, item.model.width_m / 2.0]).all(axis=-1))
