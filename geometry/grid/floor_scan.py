"""One picture as evidence, by its floor mask or its depth: free floor, and contacts where an obstacle begins."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_opening

from edgemap.geometry.arrays import Array
from edgemap.geometry.camera.depth_points import SparseDepth
from edgemap.geometry.camera.floor import FloorCamera, on_floor
from edgemap.geometry.camera.intrinsics import Intrinsics
from edgemap.geometry.grid.occupancy_grid import GridRule
from edgemap.geometry.grid.patch import Cells
from edgemap.geometry.observations.floor_mask import FloorMask
from edgemap.geometry.se2 import SE2

Mask = NDArray[np.bool_]
EDGE = 0.5  # probability at which floor ends


@dataclass(frozen=True, slots=True, eq=False)
class FloorScan:
    """contacts_base_m: (N, 2), where the floor first meets an obstacle, base frame. weights: (N,), 0 to 1; where the
    mask has walls, times 4/3 for a wall and 2/3 for a certain non-wall, since furniture overhangs and moves. Cells
    behind a contact are not part of the scan. free: (rows, columns) of the mask, 0 to 1: confidence that floor is
    visible; 0 in the boxes of detections, where it may be the top of a couch or lie below a table.
    """

    contacts_base_m: Array
    weights: Array
    free: NDArray[np.float32]
    camera: FloorCamera
    rule: GridRule

    @classmethod
    def of(
        cls, mask: FloorMask, camera: FloorCamera, movers_px: Array, detected_px: Array, rule: GridRule
    ) -> "FloorScan":
        """mask: of a picture by this camera, with that frame's attitude. movers_px: boxes (M, 4) of people and animals,
        which make no obstacle within a cell of the mask. detected_px: boxes (N, 4) of all detections."""
        floor = mask.floor
        seen = _lowest_run(_runs(floor > EDGE, rule.run), floor > EDGE)
        solid = seen & _runs(floor > rule.floor, rule.run)
        row, column, share = _contacts(mask, seen)
        pixels, rays = (
            lattice[row, column] + share[:, None] * (lattice[row - 1, column] - lattice[row, column])
            for lattice in _middles(camera.intrinsics, *floor.shape)
        )
        still = ~inside_boxes(pixels, movers_px, mask.width / floor.shape[1])
        lens = camera.mount.position_base_m()
        points = on_floor(rays[still], camera.mount.rotation_base_optical(), lens)
        away_m2 = np.square(points - lens[:2]).sum(axis=1)
        weights = row_weights(away_m2, camera, mask.height / len(floor), rule)
        if mask.wall is not None:
            weights *= (1.0 + mask.wall[row - 2, column][still]) / 1.5
        measured = weights > 0.0
        free = np.where(solid, np.clip((floor - EDGE) / 0.4, 0.0, 1.0), np.float32(0.0)).astype(np.float32)
        cell_px = np.array([mask.width, mask.height] * 2) / (free.shape[::-1] * 2)
        for x0, y0, x1, y1 in np.rint(np.maximum(detected_px, 0.0) / cell_px).astype(int).tolist():
            free[y0:y1, x0:x1] = 0.0
        return cls(points[measured], weights[measured], free, camera, rule)

    def free_cells(self, pose_map_base: SE2, cell_m: float) -> tuple[Cells, Array]:
        """Cells (N, 2), column and row in the map, whose floor is visible in this picture, and their weights (N,), 0 to
        1.
        """
        lens, mount = self.camera.intrinsics, self.camera.mount
        rotation = mount.rotation_base_optical().copy()
        rotation[:2] = pose_map_base.rotation() @ rotation[:2]
        middle = pose_map_base.apply(mount.position_base_m()[:2])
        border = _border_rays(lens)
        low, high = _box(border @ rotation.T, mount.height_m, self.rule.reach_m)
        first, last = (np.floor((middle + corner) / cell_m).astype(np.int32) for corner in (low, high))
        x, y = ((np.arange(first[k], last[k] + 1) + 0.5) * cell_m - middle[k] for k in (0, 1))
        # Optical coordinates are linear in both: no cell is projected by itself.
        ahead, right, down = (
            x * rotation[0, axis] + (y * rotation[1, axis])[:, None] - mount.height_m * rotation[2, axis]
            for axis in (2, 0, 1)
        )
        (left, top), (most_right, bottom) = border[:, :2].min(axis=0), border[:, :2].max(axis=0)
        seen = (right > left * ahead) & (right < most_right * ahead) & (down > top * ahead) & (down < bottom * ahead)
        at = np.flatnonzero(seen & (ahead > 1e-6))
        ideal = np.column_stack([right.ravel()[at], down.ravel()[at]]) / ahead.ravel()[at, None]
        pixels = lens.distortion.distort(ideal) * [lens.fx, lens.fy] + [lens.cx, lens.cy]
        rows, columns = self.free.shape
        row = np.clip((pixels[:, 1] + 0.5) * (rows / lens.height), 0, rows - 1).astype(np.intp)
        column = np.clip((pixels[:, 0] + 0.5) * (columns / lens.width), 0, columns - 1).astype(np.intp)
        free = self.free[row, column].astype(np.float64)
        at, free = at[free > 0.0], free[free > 0.0]
        cells = np.column_stack([at % len(x), at // len(x)])
        away_m2 = x[cells[:, 0]] ** 2 + y[cells[:, 1]] ** 2
        weights = free * row_weights(away_m2, self.camera, lens.height / rows, self.rule)
        counts = weights > 0.0
        return cells[counts].astype(np.int32) + first, weights[counts]


def row_weights(away_m2: Array, camera: FloorCamera, row_px: float, rule: GridRule) -> Array:
    """Weight of floor evidence, 0 to 1, (N,), from its squared distance to the point below the lens (N,): it falls with
    the extent of floor that a row of the mask covers there; 0 for NaN and beyond the reach.
    """
    height_m, focal_rows = camera.mount.height_m, camera.intrinsics.fy / row_px
    row_m = (away_m2 + height_m**2) / (height_m * focal_rows)
    return np.where(away_m2 < rule.reach_m**2, np.minimum(rule.row_m / np.maximum(row_m, 1e-9), 1.0), 0.0)


def _box(rays: Array, height_m: float, reach_m: float) -> tuple[Array, Array]:
    """Lowest and highest x, y (2,) from the lens of the floor between rays (N, 3) of a level frame, within reach."""
    flat_m = np.maximum(np.hypot(rays[:, 0], rays[:, 1]), 1e-9)
    away_m = np.minimum(height_m * flat_m / np.maximum(-rays[:, 2], 1e-9), reach_m)
    ends = rays[:, :2] * (away_m / flat_m)[:, None]
    return ends.min(axis=0), ends.max(axis=0)


@lru_cache(maxsize=8)
def _border_rays(lens: Intrinsics) -> Array:
    """Rays (N, 3), z = 1, of the optical frame along the outer border of the picture."""
    x, y = (np.linspace(-0.5, side - 0.5, 12) for side in (lens.width, lens.height))
    sides = [(x, y[0]), (x, y[-1]), (x[0], y), (x[-1], y)]
    rays = lens.rays(np.concatenate([np.column_stack(np.broadcast_arrays(u, v)) for u, v in sides]))
    rays.setflags(write=False)
    return rays


def _runs(floor: Mask, rows: int) -> Mask:
    """The cells that belong to so many in a column, at least."""
    return np.asarray(binary_opening(floor, np.ones((rows, 1), np.bool_)), dtype=np.bool_)


def _lowest_run(runs: Mask, floor: Mask) -> Mask:
    """The lowest run of floor in each column; floor above its end is behind an obstacle."""
    begun = np.logical_or.accumulate(runs[::-1], axis=0)
    ended = np.logical_or.accumulate(begun & ~floor[::-1], axis=0)
    return runs & ~ended[::-1]


def _contacts(mask: FloorMask, runs: Mask) -> tuple[NDArray[np.intp], NDArray[np.intp], Array]:
    """Where a run of floor ends upwards in a column and two rows of something else begin: the topmost row of the run,
    the column, and how far from that row's middle to that of the row above it ends, 0 to 1, each (N,)."""
    odds = mask.floor
    row, column = np.nonzero(runs[2:] & (odds[1:-1] <= EDGE) & (odds[:-2] <= EDGE))
    row = row + 2
    below, above = (odds[at, column].astype(np.float64) for at in (row, row - 1))
    return row, column, np.asarray((below - EDGE) / (below - above), dtype=np.float64)


@lru_cache(maxsize=4)
def _middles(lens: Intrinsics, rows: int, columns: int) -> tuple[Array, Array]:
    """Pixels (rows, columns, 2) of the middles of a mask's cells, and their rays (rows, columns, 3)."""
    u = (np.arange(columns) + 0.5) * (lens.width / columns) - 0.5
    v = (np.arange(rows) + 0.5) * (lens.height / rows) - 0.5
    pixels = np.stack(np.meshgrid(u, v), axis=-1).astype(np.float64)
    return pixels, lens.rays(pixels.reshape(-1, 2)).reshape(rows, columns, 3)


def inside_boxes(pixels: Array, boxes: Array, margin_px: float) -> NDArray[np.bool_]:
    """Which pixels (N, 2) lie in any of the boxes (M, 4), (N,)."""
    x, y = pixels[:, :1], pixels[:, 1:]
    x0, y0, x1, y1 = np.asarray(boxes, dtype=np.float64).reshape(-1, 4).T
    hit = (x > x0 - margin_px) & (x < x1 + margin_px) & (y > y0 - margin_px) & (y < y1 + margin_px)
    return np.asarray(hit.any(axis=1), dtype=np.bool_)


def depth_evidence(depth: SparseDepth, camera: FloorCamera, movers_px: Array, rule: GridRule) -> tuple[Array, Array]:
    """Points (N, 2) of the floor and of obstacles, base frame, by their height above the floor, whose error grows with
    range through the attitude. Points above the robot are no evidence. movers_px: boxes (M, 4) of people and animals,
    which make no obstacle within one point of the lattice."""
    points, pixels = depth.points(camera.intrinsics, rule.reach_m)
    base = points @ camera.mount.rotation_base_optical().T + camera.mount.position_base_m()
    unsure_m = rule.obstacle_m + rule.obstacle_per_m * np.hypot(base[:, 0], base[:, 1])
    top_m = max(camera.mount.height_m, rule.robot_height_m)
    at = np.flatnonzero((base[:, 2] > unsure_m) & (base[:, 2] < top_m))
    at = at[~inside_boxes(pixels[at], movers_px, depth.every_px)]
    return base[np.abs(base[:, 2]) <= unsure_m, :2], base[at, :2]
