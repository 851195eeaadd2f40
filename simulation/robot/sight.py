"""Estimate of the furniture's visibility from the plan alone, without rendering."""

import numpy as np
from numpy.typing import NDArray

from edgemap.geometry.camera.intrinsics import Intrinsics
from edgemap.geometry.camera.mount import Mount
from edgemap.runtime.inputs.drives.drive import SEEN_SIDE_PX
from edgemap.simulation.apartment.apartment import Apartment
from edgemap.simulation.apartment.placed import ALIVE
from edgemap.simulation.render.mesh import Array
from edgemap.simulation.robot.plan_grid import PlanGrid

# Sample points of a piece in units of its half sides and its height: enough to tell a third from a half.
_ACROSS, _ALONG, _UP = (-0.8, 0.0, 0.8), (-0.7, 0.7), (0.2, 0.55, 0.9)
_RAY_STEPS = 48
_NEAREST_M, _FARTHEST_M = 0.4, 7.0


class VisibilityEstimate:
    """Estimates visible shares of the labelled pieces on the floor, those alive left out.

    ids: of those pieces, in the columns' order. Furniture hides as its bounding box would, so chairs and tables, which
    one sees through, hide more here than in the picture: the estimate is a cautious one.
    """

    def __init__(self, apartment: Apartment, grid: PlanGrid, intrinsics: Intrinsics, mount: Mount) -> None:
        self._grid, self._intrinsics, self._mount = grid, intrinsics, mount
        items = [item for item in apartment.furniture if item.label and item.on_floor and item.label not in ALIVE]
        self.ids = np.array([item.id for item in items], dtype=np.int64)
        self.middles_m = np.array([[i.pose_home_object.x_m, i.pose_home_object.y_m] for i in items]).reshape(-1, 2)
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
        row, column = self._grid.cells_of(rays[..., :2])
        other = self._grid.owner[row, column] != self.ids[which[1]][:, None]
        return ~((self._grid.tops_m[row, column] > rays[..., 2]) & other).any(axis=1)
