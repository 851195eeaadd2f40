"""Cells of the map in arrays that grow with it."""

import numpy as np
from numpy.typing import NDArray

from edgemap.geometry.grid.patch import Cells, Patch, Steps, after
from edgemap.geometry.se2 import SE2

MARGIN = 64  # cells by which it grows, at least
LONGEST = 8192  # cells of a side: 400 m; what lies farther off is not kept


class Canvas:
    """The log-odds of all cells, and the additions of the newest patch. bounds: of log-odds, in steps."""

    def __init__(self, low: int, high: int) -> None:
        self.low, self.high = low, high
        self.first = np.zeros(2, np.int32)  # column and row of the arrays' first cell
        self.odds: Steps = np.zeros((0, 0), np.int16)
        self._shift = self._low = self._high = self.odds

    def include(self, cells: Cells) -> NDArray[np.bool_]:
        """Grows the arrays to include cells (N, 2). Returns which of them fit, (N,)."""
        if not len(cells):
            return np.zeros(0, np.bool_)
        self._cover(cells.min(axis=0), cells.max(axis=0) + 1)
        column, row = (cells - self.first).T
        rows, columns = self.odds.shape
        return (column >= 0) & (row >= 0) & (column < columns) & (row < rows)

    def add(self, cells: Cells, steps: Steps) -> None:
        """Change the log-odds of cells (N, 2), none twice, by steps (N,), as part of the newest patch."""
        has_room = self.include(cells)
        at, steps = self._flat(cells[has_room]), steps[has_room]
        self.odds.ravel()[at] = np.clip(self.odds.ravel()[at] + steps, self.low, self.high)
        columns = [array.ravel() for array in (self._shift, self._low, self._high)]
        bounds = np.int16(self.low), np.int16(self.high)
        later = (steps, *(np.full(len(steps), bound) for bound in bounds))
        for array, values in zip(columns, after([array[at] for array in columns], later), strict=True):
            array[at] = values

    def take_patch(self, stamp_s: float, began: SE2) -> Patch:
        """Returns the evidence added since the last call as a patch, with the stamp and pose at which it began."""
        at = np.flatnonzero((self._low > self.low) | (self._high < self.high))
        rows, columns = np.unravel_index(at, self.odds.shape) if len(at) else (at, at)
        cells = np.column_stack([columns, rows]).astype(np.int32) + self.first
        columns = [array.ravel() for array in (self._shift, self._low, self._high)]
        shift, low, high = (array[at] for array in columns)
        patch = Patch(stamp_s, began, cells, shift, low, high)
        for array, value in zip(columns, (0, self.low, self.high), strict=True):
            array[at] = value
        return patch

    def draw(self, patch: Patch, cell_m: float, newest: bool = False) -> None:
        """Applies a patch to the log-odds at its current place. newest: whether later additions belong to it."""
        cells = patch.placed(cell_m)
        has_room = self.include(cells)
        at, odds = self._flat(cells[has_room]), self.odds.ravel()
        shift, low, high = (values[has_room] for values in (patch.shift, patch.low, patch.high))
        odds[at] = np.clip(odds[at] + shift.astype(np.int32), low, high)
        if newest:
            for array, values in zip((self._shift, self._low, self._high), (shift, low, high), strict=True):
                array.ravel()[at] = values

    def _flat(self, cells: Cells) -> NDArray[np.intp]:
        column, row = (cells - self.first).T
        return row.astype(np.intp) * self.odds.shape[1] + column

    def _cover(self, low: NDArray[np.int32], high: NDArray[np.int32]) -> None:
        """Grows the arrays to include the cells from low up to, not including, high, within LONGEST."""
        size = np.array(self.odds.shape[::-1], np.int32)
        if size.all():
            if (low >= self.first).all() and (high <= self.first + size).all():
                return
            ends = self.first + size
            low = np.where(low < self.first, np.maximum(low - MARGIN, ends - LONGEST), self.first)
            high = np.where(high > ends, np.minimum(high + MARGIN, low + LONGEST), ends)
        else:
            low, high = low - MARGIN, np.minimum(high + MARGIN, low + LONGEST - MARGIN)
        columns, rows = (high - low).tolist()
        before = (slice(*(self.first[1] - low[1] + [0, size[1]])), slice(*(self.first[0] - low[0] + [0, size[0]])))
        for name, value in (("odds", 0), ("_shift", 0), ("_low", self.low), ("_high", self.high)):
            array = np.full((rows, columns), value, np.int16)
            if size.all():
                array[before] = getattr(self, name)
            setattr(self, name, array)
        self.first = low.astype(np.int32)
