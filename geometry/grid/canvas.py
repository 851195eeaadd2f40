"""The evidence on all cells of a map in arrays that grow with it; saved grids as evidence, and two grids as one."""

import math

import numpy as np

from edgemap.geometry.grid.occupancy_grid import STEPS, GridRule, OccupancyGrid
from edgemap.geometry.grid.patch import UNIT, Cells, Patch, Steps, after, columns_rows, placed
from edgemap.geometry.se2 import SE2

MARGIN = 64  # cells by which it grows, at least
LONGEST = 8192  # cells of a side: 400 m; what lies farther off is not kept


class Canvas:
    """Arrays of cells that grow: one layer, the log-odds, of a map; of evidence that becomes a patch three, its changes
    of log-odds as in `Patch`. A map's has a `grid`, evidence's a `patch`.
    """

    def __init__(self, rule: GridRule, evidence: bool = False) -> None:
        self._cell_m, bound = rule.cell_m, round(rule.highest * UNIT)
        self._values = np.array([0, -bound, bound] if evidence else [0], np.int16)  # of cells without evidence
        self._first = np.zeros(2, np.int32)  # column and row of the arrays' first cell
        self._layers = np.zeros((len(self._values), 0, 0), np.int16)

    def add(self, cells: Cells, changes: Steps) -> None:
        """Applies functions (3, N) to cells (N, 2); where a turned patch has two of them on one, the last counts."""
        self._cover(cells)
        column, row = (cells - self._first).T
        layers, rows, columns = self._layers.shape
        fits = (column >= 0) & (row >= 0) & (column < columns) & (row < rows)
        at = row[fits].astype(np.intp) * columns + column[fits]
        flat = self._layers.reshape(layers, -1)
        flat[:, at] = after(flat[:, at], changes[:, fits])

    def draw(self, patch: Patch) -> None:
        """Applies a patch at its current place."""
        self.add(placed(patch.cells, patch.move, self._cell_m), patch.changes)

    def patch(self, stamp_s: float, began: SE2) -> Patch:
        """All evidence as a patch, with the stamp and pose at which it began."""
        _, low, high = self._layers
        rows, columns = np.nonzero((low > self._values[1]) | (high < self._values[2]))
        cells = np.column_stack([columns, rows]).astype(np.int32) + self._first
        return Patch(stamp_s, began, cells, self._layers[:, rows, columns])

    def grid(self, revision: int = 0) -> OccupancyGrid | None:
        """The observed part; None without any."""
        (odds,) = self._layers
        rows, columns = np.flatnonzero(odds.any(axis=1)), np.flatnonzero(odds.any(axis=0))
        if not len(rows):
            return None
        log_odds = odds[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1] * np.float32(STEPS / UNIT)
        x_m, y_m = ((self._first + [columns[0], rows[0]]) * self._cell_m).tolist()
        return OccupancyGrid(np.rint(log_odds, out=log_odds).astype(np.int8), x_m, y_m, self._cell_m, revision=revision)

    def _cover(self, cells: Cells) -> None:
        """Grows the arrays to include cells (N, 2), but for those that are not worth the span to them."""
        if not self._layers.size and len(cells):
            self._first = cells.min(axis=0) - MARGIN
        first, ends = self._first, self._first + self._layers.shape[:0:-1]
        near = cells[((cells >= ends - LONGEST) & (cells < first + LONGEST)).all(axis=1)]
        if not len(near) or ((near >= first) & (near < ends)).all():
            return
        low, high = near.min(axis=0), near.max(axis=0) + 1
        low = np.where(low < first, np.maximum(low - MARGIN, ends - LONGEST), first)
        high = np.where(high > ends, np.minimum(high + MARGIN, low + LONGEST), ends)
        (before_x, before_y), (columns, rows) = (first - low).tolist(), (high - low).tolist()
        old, self._first = self._layers, low.astype(np.int32)
        self._layers = np.tile(self._values[:, None, None], (rows, columns))
        self._layers[:, before_y : before_y + old.shape[1], before_x : before_x + old.shape[2]] = old


def additions(steps: Steps, rule: GridRule) -> Steps:
    """Functions (3, N) that add steps (N,) within the rule's bounds."""
    bound = np.full(len(steps), round(rule.highest * UNIT), np.int16)
    return np.stack([steps, -bound, bound])


def saved_patch(saved: OccupancyGrid, rule: GridRule) -> Patch:
    """A saved grid as evidence that no correction moves, by this run's cells."""
    observed = saved.log_odds != 0
    steps = np.rint(saved.log_odds[observed] * (UNIT / STEPS)).astype(np.int16)
    cells = columns_rows(saved.centres_m(observed), rule.cell_m)
    cells, one = np.unique(cells, axis=0, return_index=True)  # where its cells are smaller than these
    return Patch(-math.inf, SE2(), cells, additions(steps[one], rule))


def merged_grid(first: OccupancyGrid | None, second: OccupancyGrid | None, pose_a_b: SE2) -> OccupancyGrid | None:
    """Two saved grids in the first one's frame, with the second one's pose `pose_a_b`; log-odds add up."""
    rule = GridRule()
    canvas = Canvas(rule)
    for saved, move in ((first, SE2()), (second, pose_a_b)):
        if saved is not None:
            patch = saved_patch(saved, rule)
            patch.move = move
            canvas.draw(patch)
    return canvas.grid()
