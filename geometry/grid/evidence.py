"""Evidence of one picture by cell: of several measurements of one kind in a cell, the strongest counts."""

import numpy as np

from edgemap.geometry.arrays import Array
from edgemap.geometry.grid.patch import UNIT, Cells, Steps, packed


class Evidence:
    """Log-odds for and against obstacles in cells of the map, collected from one picture and summed."""

    def __init__(self, cell_m: float) -> None:
        self.cell_m = cell_m
        self._free: list[tuple[Cells, Array]] = []
        self._occupied: list[tuple[Cells, Array]] = []

    def free(self, cells: Cells, log_odds: Array | float) -> None:
        """Adds free evidence to cells (N, 2): log-odds (N,), positive."""
        self._free.append((cells, np.broadcast_to(log_odds, len(cells))))

    def occupied(self, cells: Cells, log_odds: Array | float) -> None:
        """Adds occupied evidence to cells (N, 2): log-odds (N,), positive."""
        self._occupied.append((cells, np.broadcast_to(log_odds, len(cells))))

    def steps(self) -> tuple[Cells, Steps]:
        """The distinct cells (N, 2), and the change of each one's log-odds in steps (N,)."""
        every = np.concatenate([np.zeros((0, 2), np.int32), *(cells for cells, _ in (*self._free, *self._occupied))])
        if not len(every):
            return every, np.zeros(0, np.int16)
        low = every.min(axis=0)
        columns, rows = (every.max(axis=0) + 1 - low).tolist()
        total = np.zeros(rows * columns)
        for sign, parts in ((-1.0, self._free), (1.0, self._occupied)):
            strongest = np.zeros(rows * columns)
            for cells, log_odds in parts:
                column, row = (cells - low).T
                np.maximum.at(strongest, row.astype(np.intp) * columns + column, log_odds)
            total += sign * strongest
        steps = np.rint(total * UNIT).astype(np.int16)
        at = np.flatnonzero(steps)
        return np.column_stack([at % columns, at // columns]).astype(np.int32) + low, steps[at]


def repeated(cells: Cells) -> Cells:
    """The distinct cells among (N, 2) that occur more than once."""
    _, first, counts = np.unique(packed(cells), return_index=True, return_counts=True)
    return cells[first[counts > 1]]
