"""Cells of the map in arrays that grow with it; saved grids as evidence, and two grids of one place as one."""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from edgemap.geometry.grid.occupancy_grid import STEPS, GridRule, OccupancyGrid
from edgemap.geometry.grid.patch import UNIT, Cells, Patch, Steps, after, columns_rows, placed
from edgemap.geometry.se2 import SE2

MARGIN = 64  # cells by which it grows, at least
LONGEST = 8192  # cells of a side: 400 m; what lies farther off is not kept


class Layers:
    """Arrays of one size, one for each of `values`, that grow to hold cells; new cells have these values."""

    def __init__(self, *values: int) -> None:
        self.first = np.zeros(2, np.int32)  # column and row of the arrays' first cell
        self.arrays: list[Steps] = [np.zeros((0, 0), np.int16) for _ in values]
        self._values = values

    def at(self, cells: Cells) -> tuple[NDArray[np.intp], NDArray[np.bool_]]:
        """Grows to include cells (N, 2). Returns the flat places (M,) of those that fit, and which fit (N,)."""
        if not self.arrays[0].size and len(cells):
            self.first = cells.min(axis=0) - MARGIN
        # Cells far off are not worth the span to them.
        ends = self.first + self.arrays[0].shape[::-1]
        near = cells[((cells >= ends - LONGEST) & (cells < self.first + LONGEST)).all(axis=1)]
        if len(near):
            self._cover(near.min(axis=0), near.max(axis=0) + 1)
        column, row = (cells - self.first).T
        rows, columns = self.arrays[0].shape
        fits = (column >= 0) & (row >= 0) & (column < columns) & (row < rows)
        return row[fits].astype(np.intp) * columns + column[fits], fits

    def _cover(self, low: Cells, high: Cells) -> None:
        """Grows the arrays to include the cells from low up to, not including, high, within LONGEST."""
        ends = self.first + self.arrays[0].shape[::-1]
        if (low >= self.first).all() and (high <= ends).all():
            return
        low = np.where(low < self.first, np.maximum(low - MARGIN, ends - LONGEST), self.first)
        high = np.where(high > ends, np.minimum(high + MARGIN, low + LONGEST), ends)
        more = np.stack([self.first - low, high - ends], axis=1)[::-1]  # rows, then columns: before and after
        self.arrays = [
            np.pad(array, more, constant_values=value) for array, value in zip(self.arrays, self._values, strict=True)
        ]
        self.first = low.astype(np.int32)


class Canvas:
    """The log-odds of all cells, and the additions of the newest patch, in steps."""

    def __init__(self, rule: GridRule) -> None:
        self._cell_m, self._bound = rule.cell_m, round(rule.highest * UNIT)
        self._odds, self._newest = Layers(0), Layers(0, -self._bound, self._bound)  # of the latter shift, low and high

    @property
    def odds(self) -> Steps:
        """Log-odds (rows, columns), in steps."""
        return self._odds.arrays[0]

    def add(self, cells: Cells, steps: Steps) -> None:
        """Change the log-odds of cells (N, 2), none twice, by steps (N,), as part of the newest patch."""
        at, fits = self._odds.at(cells)
        cells, steps = cells[fits], steps[fits]
        odds = self.odds.ravel()
        odds[at] = np.clip(odds[at] + steps, -self._bound, self._bound)
        at, fits = self._newest.at(cells)
        bound = np.full(len(at), self._bound, np.int16)
        self._note(at, after([array.ravel()[at] for array in self._newest.arrays], (steps[fits], -bound, bound)))

    def take_patch(self, stamp_s: float, began: SE2) -> Patch:
        """Returns the evidence added since the last call as a patch, with the stamp and pose at which it began."""
        newest, self._newest = self._newest, Layers(0, -self._bound, self._bound)
        _, low, high = newest.arrays
        rows, columns = np.nonzero((low > -self._bound) | (high < self._bound))
        cells = np.column_stack([columns, rows]).astype(np.int32) + newest.first
        shift, low, high = (array[rows, columns] for array in newest.arrays)
        return Patch(stamp_s, began, cells, shift, low, high)

    def draw(self, patch: Patch, newest: bool = False) -> None:
        """Applies a patch to the log-odds at its current place. newest: whether later additions belong to it."""
        cells = placed(patch.cells, patch.move, self._cell_m)
        at, fits = self._odds.at(cells)
        odds = self.odds.ravel()
        values = [array[fits] for array in (patch.shift, patch.low, patch.high)]
        odds[at] = np.clip(odds[at] + values[0].astype(np.int32), *values[1:])
        if newest:
            at, fits = self._newest.at(cells[fits])
            self._note(at, [array[fits] for array in values])

    def grid(self, revision: int = 0) -> OccupancyGrid | None:
        """The observed part; None without any."""
        rows, columns = np.flatnonzero(self.odds.any(axis=1)), np.flatnonzero(self.odds.any(axis=0))
        if not len(rows):
            return None
        part = self.odds[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
        log_odds = part * np.float32(STEPS / UNIT)
        x_m, y_m = ((self._odds.first + [columns[0], rows[0]]) * self._cell_m).tolist()
        return OccupancyGrid(np.rint(log_odds, out=log_odds).astype(np.int8), x_m, y_m, self._cell_m, revision=revision)

    def _note(self, at: NDArray[np.intp], values: Sequence[Steps]) -> None:
        """Sets what the newest patch adds to its cells."""
        for array, given in zip(self._newest.arrays, values, strict=True):
            array.ravel()[at] = given


def saved_patch(saved: OccupancyGrid, rule: GridRule) -> Patch:
    """A saved grid as evidence that no correction moves, by this run's cells."""
    observed = saved.log_odds != 0
    cells = columns_rows(saved.centres_m(observed), rule.cell_m)
    steps = np.rint(saved.log_odds[observed] * (UNIT / STEPS)).astype(np.int16)
    _, one = np.unique(cells, axis=0, return_index=True)  # where its cells are smaller than these
    bound = np.full(len(one), round(rule.highest * UNIT), np.int16)
    return Patch(-math.inf, SE2(), cells[one], np.clip(steps[one], -bound, bound), -bound, bound)


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
