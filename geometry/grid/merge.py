"""Saved grids as evidence, evidence as a grid, and two grids of one place as one."""

import math

import numpy as np

from edgemap.geometry.grid.canvas import Canvas
from edgemap.geometry.grid.occupancy_grid import STEPS, GridRule, OccupancyGrid
from edgemap.geometry.grid.patch import UNIT, Patch, columns_rows
from edgemap.geometry.se2 import SE2


def merged_grid(first: OccupancyGrid | None, second: OccupancyGrid | None, pose_a_b: SE2) -> OccupancyGrid | None:
    """Two saved grids in the first one's frame, with the second one's pose `pose_a_b`; log-odds add up."""
    rule = GridRule()
    canvas = Canvas(rule)
    for saved, move in ((first, SE2()), (second, pose_a_b)):
        if saved is not None:
            patch = saved_patch(saved, rule)
            patch.move = move
            canvas.draw(patch)
    return grid_of(canvas, rule)


def grid_of(canvas: Canvas, rule: GridRule, revision: int = 0) -> OccupancyGrid | None:
    """The observed part of a canvas; None for an empty one."""
    rows, columns = np.flatnonzero(canvas.odds.any(axis=1)), np.flatnonzero(canvas.odds.any(axis=0))
    if not len(rows):
        return None
    part = canvas.odds[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
    log_odds = part * np.float32(STEPS / UNIT)
    x_m, y_m = ((canvas.first + [columns[0], rows[0]]) * rule.cell_m).tolist()
    return OccupancyGrid(np.rint(log_odds, out=log_odds).astype(np.int8), x_m, y_m, rule.cell_m, revision=revision)


def saved_patch(saved: OccupancyGrid, rule: GridRule) -> Patch:
    """A saved grid as evidence that no correction moves, by this run's cells."""
    observed = saved.log_odds != 0
    cells = columns_rows(saved.centres_m(observed), rule.cell_m)
    steps = np.rint(saved.log_odds[observed] * (UNIT / STEPS)).astype(np.int16)
    _, one = np.unique(cells, axis=0, return_index=True)  # where its cells are smaller than these
    bound = np.full(len(one), round(rule.highest * UNIT), np.int16)
    return Patch(-math.inf, SE2(), cells[one], np.clip(steps[one], -bound, bound), -bound, bound)
