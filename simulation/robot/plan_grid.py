"""The home from above on a grid: heights, owners, clearance; and from it an estimate of the furniture's visibility."""

import math

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt, map_coordinates

from edgemap.geometry.camera.intrinsics import Intrinsics
from edgemap.geometry.camera.mount import Mount
from edgemap.runtime.inputs.drives.drive import SEEN_SIDE_PX
from edgemap.simulation.apartment.apartment import Apartment
from edgemap.simulation.apartment.layout import ALIVE
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
        centres = np.stack([x, y], axis=-1)
        self.tops_m = np.zeros((rows, columns), dtype=np.float32)
        self.owner = np.zeros((rows, columns), dtype=np.int32)
        blocked = np.zeros((rows, columns), dtype=bool)
        for item in apartment.furniture:
            if item.z_m > _OVERHEAD_M:
                continue
            local = np.abs(item.pose_home_object.inverse().apply(centres))
            inside = np.asarray((local <= [item.model.depth_m / 2.0, item.model.width_m / 2.0]).all(axis=-1))
            top = item.z_m + item.model.height_m
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


# Sample points of a piece in units of its half sides and its height: enough to distinguish a third from a half.
_ACROSS, _ALONG, _UP = (-0.8, 0.0, 0.8), (-0.7, 0.7), (0.2, 0.55, 0.9)
_RAY_STEPS = 48
_NEAREST_M, _FARTHEST_M = 0.4, 7.0


class VisibilityEstimate:
    """Estimates visible shares of the labelled pieces on the floor, those alive left out.

    grid: of the home. ids: of those pieces, in the columns' order. Furniture hides as its bounding box would, so chairs
    and tables, which one sees through, hide more here than in the picture: the estimate is a cautious one.
    """

    def __init__(self, apartment: Apartment, grid: PlanGrid, intrinsics: Intrinsics, mount: Mount) -> None:
        self.grid, self._intrinsics, self._mount = grid, intrinsics, mount
        items = [item for item in apartment.furniture if item.label and item.on_floor and item.label not in ALIVE]
        self.ids = np.array([item.id for item in items], dtype=np.int64)
        self.middles_m = np.array([item.middle_home_m for item in items]).reshape(-1, 2)
        pattern = np.array([(a, b, c) for a in _ALONG for b in _ACROSS for c in _UP])
        self._points = np.empty((len(items), len(pattern), 3))
        for row, item in enumerate(items):
            half = np.array([item.model.depth_m / 2.0, item.model.width_m / 2.0])
            self._points[row, :, :2] = item.pose_home_object.apply(pattern[:, :2] * half)
            self._points[row, :, 2] = pattern[:, 2] * item.model.height_m
        self._sides_m = np.array([max(item.model.width_m, item.model.height_m) for item in items])

    def shares(self, poses: Array) -> Array:
        """Visible shares (N, pieces) 0..1 from poses (N, 3) of the base: x, y in metres, yaw in radians."""
        poses = np.asarray(poses, dtype=np.float64).reshape(-1, 3)
        if not len(self.ids):
            return np.zeros((len(poses), 0))
        c, s = np.cos(poses[:, 2]), np.sin(poses[:, 2])
        apart = self._points[None, :, :, :2] - poses[:, None, None, :2]
        base = np.empty((len(poses), *self._points.shape))
        base[..., 0] = c[:, None, None] * apart[..., 0] + s[:, None, None] * apart[..., 1]
        base[..., 1] = -s[:, None, None] * apart[..., 0] + c[:, None, None] * apart[..., 1]
        base[..., 2] = self._points[None, ..., 2]
        position = self._mount.position_base_m()
        optical = (base - position) @ self._mount.rotation_base_optical()
        depth = np.maximum(optical[..., 2], 1e-6)
        lens = self._intrinsics
        column = lens.fx * optical[..., 0] / depth + lens.cx
        row = lens.fy * optical[..., 1] / depth + lens.cy
        inside = (optical[..., 2] > _NEAREST_M) & (optical[..., 2] < _FARTHEST_M)
        inside &= (column > 0) & (column < lens.width) & (row > 0) & (row < lens.height)
        large = lens.fx * self._sides_m / depth.mean(axis=2) > 1.5 * SEEN_SIDE_PX
        inside &= large[..., None]
        which = np.nonzero(inside)
        eyes = poses[:, :2] + np.stack([c * position[0] - s * position[1], s * position[0] + c * position[1]], axis=1)
        inside[which] = self._unhidden(np.column_stack([eyes, np.full(len(eyes), position[2])])[which[0]], which)
        return inside.mean(axis=2)

    def _unhidden(self, eyes: Array, which: tuple[NDArray[np.intp], ...]) -> Array:
        """Whether nothing stands between each eye (K, 3) and its point."""
        targets = self._points[which[1], which[2]]
        along = (np.arange(1, _RAY_STEPS) / _RAY_STEPS)[None, :, None]
        rays = eyes[:, None] + along * (targets - eyes)[:, None]
        row, column = self.grid.cells_of(rays[..., :2])
        other = self.grid.owner[row, column] != self.ids[which[1]][:, None]
        return ~((self.grid.tops_m[row, column] > rays[..., 2]) & other).any(axis=1)
