"""Evidence about cells of the map: bounded changes of their log-odds, and pieces of the drive that hold them."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from edgemap.geometry.arrays import Array
from edgemap.geometry.se2 import SE2

UNIT = 100.0  # steps of log-odds per 1
Steps = NDArray[np.int16]
Cells = NDArray[np.int32]
Evidence = tuple[Cells, Array | float]  # cells (N, 2) and the log-odds (N,) for or against obstacles there, positive


@dataclass(slots=True, eq=False)
class Patch:
    """Evidence of a piece of the drive that began at stamp_s (-inf: of a saved map, that no correction moves) with the
    robot at `began` in the map as it was then.

    cells: (N, 2), column and row in the map as it was then, none twice. changes: (3, N), shift, low and high of each
    cell's function `x -> clip(x + shift, low, high)` of its previous log-odds. A sequence of additions, each clipped to
    the bounds, has this form, so a moved patch replays its evidence exactly. move: pose of the map frame at that time
    in the current map frame. drawn: the same at the last drawing. corners: (4, 2), of the rectangle round its cells.
    """

    stamp_s: float
    began: SE2
    cells: Cells
    changes: Steps
    move: SE2 = field(default_factory=SE2)
    drawn: SE2 = field(default_factory=SE2)
    corners: Cells = field(init=False)

    def __post_init__(self) -> None:
        ends = np.array([self.cells.min(axis=0), self.cells.max(axis=0)] if len(self) else [(0, 0), (0, 0)], np.int32)
        self.corners = ends[[[0, 0], [1, 1], [0, 1], [1, 0]], [0, 1]]

    def __len__(self) -> int:
        return len(self.cells)

    def moved_m(self, cell_m: float) -> float:
        """Greatest distance along an axis that a corner moved since the patch was drawn, m."""
        now, drawn = (move.apply(self.corners * cell_m) for move in (self.move, self.drawn))
        return float(np.abs(now - drawn).max())


def placed(cells: Cells, move: SE2, cell_m: float) -> Cells:
    """Cells (N, 2) after a move of their map; duplicates are possible."""
    if move == SE2():
        return cells
    return columns_rows(move.apply((cells + 0.5) * cell_m), cell_m)


def columns_rows(points_m: Array, cell_m: float) -> Cells:
    """The cells (N, 2) that hold points (N, 2) of the map."""
    return np.floor(points_m / cell_m).astype(np.int32)


def after(before: Steps, later: Steps) -> Steps:
    """Log-odds (1, N), or functions `clip(x + shift, low, high)` (3, N), after functions later (3, N) of shift, low and
    high: two functions in turn are one again."""
    shifted = before + later[0]
    values = np.clip(shifted, later[1], later[2])
    if len(before) == 3:  # sums of two shifts stay within 16 bits; by then all log-odds are at a bound
        np.clip(shifted[0], -16_000, 16_000, out=values[0])
    return values


def summed(free: Sequence[Evidence], occupied: Sequence[Evidence]) -> tuple[Cells, Steps]:
    """The distinct cells (N, 2) of one picture's evidence, and the change of each one's log-odds in steps (N,): of each
    kind the strongest counts."""
    every = np.concatenate([cells for cells, _ in (*free, *occupied)])
    low = every.min(axis=0)
    columns, rows = (every.max(axis=0) + 1 - low).tolist()
    total = np.zeros(rows * columns)
    for sign, parts in ((-1.0, free), (1.0, occupied)):
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
    packed = cells.astype(np.int64) @ np.array([1, 1 << 32])  # one number for each
    _, first, counts = np.unique(packed, return_index=True, return_counts=True)
    return cells[first[counts > 1]]
