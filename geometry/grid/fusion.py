"""The occupancy grid of a drive: fused picture by picture, corrected with the trajectory, bounded in size."""

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from edgemap.geometry.arrays import Array
from edgemap.geometry.camera.depth_points import SparseDepth
from edgemap.geometry.camera.floor import FloorCamera
from edgemap.geometry.grid.canvas import Canvas, additions, saved_patch
from edgemap.geometry.grid.floor_scan import FloorScan, depth_evidence
from edgemap.geometry.grid.occupancy_grid import GridRule, OccupancyGrid
from edgemap.geometry.grid.patch import Cells, Evidence, Patch, columns_rows, placed, repeated, summed
from edgemap.geometry.observations.floor_mask import FloorMask
from edgemap.geometry.se2 import SE2
from edgemap.geometry.trajectory_correction import TrajectoryCorrection, nearest_earlier

PATCHES = 96  # at most: with more, those of one place become one, so that a drive of hours takes no more memory
REDRAW_CELLS = 16_000  # drawn per step at least, so that a closure costs a bounded part of each of some steps


class GridFusion:
    """Free, occupied and unknown floor; deterministic in its inputs and their order.

    Evidence is kept in patches, one for each piece of the trajectory, that move with it; what the grid shows is all of
    them in order of time. A correction is drawn a few patches per step. scan: the newest picture's, where one was
    fused in the last `observe`.
    """

    def __init__(self, rule: GridRule | None = None) -> None:
        self.rule = rule or GridRule()
        self.scan: FloorScan | None = None
        self._patches: list[Patch] = []
        self._canvas, self._newest = Canvas(self.rule), Canvas(self.rule, evidence=True)  # the latter since `_began`
        self._drawing: Iterator[None] | None = None
        self._revision = 0
        self._shown: OccupancyGrid | None = None
        self._last: tuple[SE2, float] | None = None  # pose and stamp of the last picture that was fused
        self._began: tuple[SE2, float] | None = None  # of the newest patch's first one

    def observe(
        self,
        pose_map_base: SE2,
        stamp_s: float,
        camera: FloorCamera,
        mask: FloorMask | None,
        movers_px: Array,
        detected_px: Array,
        depth: SparseDepth | None = None,
    ) -> None:
        """Fuses a frame, where one is due: the robot's pose, the floor mask, if it was computed, and the depth, if
        there is any. movers_px: boxes (M, 4) of people and animals. detected_px: boxes (N, 4) of all detections."""
        self.scan = None
        if self._drawing is None:
            self._bound()
        else:
            next(self._drawing, None)
        if not self._is_due(pose_map_base, stamp_s):
            return
        if self._began is not None and not (self._began[0].inverse() @ pose_map_base).is_within(self.rule.patch_m):
            self._close_patch()
        if self._began is None:
            self._began = pose_map_base, stamp_s
        self._last = pose_map_base, stamp_s
        rule, occupied = self.rule, list[Evidence]()
        free: list[Evidence] = [(self._driven(pose_map_base), 2.0 * rule.highest)]
        if mask is not None:
            self.scan = FloorScan.of(mask, camera, movers_px, detected_px, rule)
            cells, weights = self.scan.free_cells(pose_map_base, rule.cell_m)
            contacts = columns_rows(pose_map_base.apply(self.scan.contacts_base_m), rule.cell_m)
            free.append((cells, rule.free * weights))
            occupied.append((contacts, rule.occupied * self.scan.weights))
        if depth is not None:
            both_m = depth_evidence(depth, camera, movers_px, rule)
            floor, hits = (columns_rows(pose_map_base.apply(points_m), rule.cell_m) for points_m in both_m)
            free.append((floor, rule.free))
            occupied.append((repeated(hits), rule.occupied))  # a single one may lie between an edge and its background
        changed, steps = summed(free, occupied)
        changes = additions(steps, rule)
        self._canvas.add(changed, changes)
        self._newest.add(changed, changes)
        self._revision += 1

    def moved(self, past: TrajectoryCorrection) -> None:
        """Applies a trajectory correction to everything observed from it."""
        self._close_patch()
        stamped = [patch for patch in self._patches if patch.stamp_s > -math.inf]
        moves = past.moved_poses([p.stamp_s for p in stamped], [p.move.vector() for p in stamped]) if stamped else []
        for patch, move in zip(stamped, moves, strict=True):
            patch.move = SE2(*move)
        self._moved_patches()

    def transform(self, pose_map_start: SE2) -> None:
        """Moves everything to another frame, in which the old one has the pose `pose_map_start`."""
        self._close_patch()
        for patch in self._patches:
            patch.move = pose_map_start @ patch.move
        self._moved_patches()

    def continue_from(self, saved: OccupancyGrid) -> None:
        """Starts from a saved map's grid, in this one's frame; new evidence is added on top."""
        self._patches.insert(0, saved_patch(saved, self.rule))
        self._drawing = self._drawn()

    def grid(self) -> OccupancyGrid | None:
        """The current grid; None before the first evidence. The same object until something changes."""
        if self._shown is None or self._shown.revision != self._revision:
            self._shown = self._canvas.grid(self._revision)
        return self._shown

    def _is_due(self, pose: SE2, stamp_s: float) -> bool:
        if self._last is None:
            return True
        near = (self._last[0].inverse() @ pose).is_within(self.rule.scan_m)
        return not near or not 0.0 <= stamp_s - self._last[1] < self.rule.scan_s

    def _driven(self, pose: SE2) -> Cells:
        """The floor below the robot."""
        rule = self.rule
        reach = math.ceil(rule.robot_m / rule.cell_m)
        at = np.array([pose.x_m, pose.y_m]) / rule.cell_m
        cells = np.floor(at).astype(np.int32) + np.mgrid[-reach : reach + 1, -reach : reach + 1].reshape(2, -1).T
        return cells[np.square(cells + 0.5 - at).sum(axis=1) <= (rule.robot_m / rule.cell_m) ** 2].astype(np.int32)

    def _close_patch(self) -> None:
        """Keeps the newest patch; the next evidence begins another one."""
        if self._began is not None and len(patch := self._newest.patch(self._began[1], self._began[0])):
            self._patches.append(patch)
            self._newest = Canvas(self.rule, evidence=True)
        self._began = None

    def _bound(self) -> None:
        """Joins the patch nearest to an earlier one with it where there are too many: their number is bounded by the
        places, not by the length of the drive. The joined evidence has the later one's age."""
        saved = sum(patch.stamp_s == -math.inf for patch in self._patches)
        if len(self._patches) - saved > PATCHES:
            poses = np.array([(patch.move @ patch.began).vector() for patch in self._patches[saved : -PATCHES // 2]])
            ((gone, kept),) = nearest_earlier(poses, 1).items()
            first, second = self._patches[saved + kept], self._patches[saved + gone]
            both = Canvas(self.rule, evidence=True)
            both.add(first.cells, first.changes)
            both.add(placed(second.cells, first.move.inverse() @ second.move, self.rule.cell_m), second.changes)
            joined = both.patch(first.stamp_s, first.began)
            self._patches[saved + gone] = replace(joined, move=first.move, drawn=first.drawn)
            del self._patches[saved + kept]

    def _moved_patches(self) -> None:
        """Draw the grid again where a patch no longer lies where it was drawn."""
        cell_m = self.rule.cell_m
        if any(patch.moved_m(cell_m) > cell_m / 2.0 for patch in self._patches):
            self._drawing = self._drawn()

    def _drawn(self) -> Iterator[None]:
        """Draws all patches, some in each step, then shows them. Evidence added meanwhile is drawn last."""
        canvas, cells = Canvas(self.rule), 0
        yield  # the step of a correction has enough to do
        for patch in self._patches:
            if cells >= REDRAW_CELLS:
                cells = 0
                yield
            canvas.draw(patch)
            patch.drawn = patch.move
            cells += len(patch)
        canvas.draw(self._newest.patch(0.0, SE2()))
        self._canvas, self._drawing = canvas, None
        self._revision += 1
