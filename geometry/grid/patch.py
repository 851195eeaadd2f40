"""Floor evidence of one piece of the drive: sequences of bounded additions, and their current place in the map."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from edgemap.geometry.arrays import Array
from edgemap.geometry.se2 import SE2
from edgemap.geometry.trajectory_correction import composed

UNIT = 100.0  # steps of log-odds per 1
Steps = NDArray[np.int16]
Cells = NDArray[np.int32]
Evidence = tuple[Cells, Array | float]  # cells (N, 2) and the log-odds (N,) for or against obstacles there, positive


@dataclass(slots=True, eq=False)
class Patch:
    """Evidence of a piece of the drive that began at stamp_s (-inf: of a saved map, that no correction moves) with the
    robot at `began` in the map as it was then.

    cells: (N, 2), column and row in the map as it was then. Each cell's evidence is the function
    `x -> clip(x + shift, low, high)` of its previous log-odds, all (N,). A sequence of additions, each clipped to the
    bounds, has this form, so a moved patch replays its evidence exactly. move: pose of the map frame at that time in
    the current map frame. drawn: the same at the last drawing. corners: (4, 2), of the rectangle
    round its cells.
    """

    stamp_s: float
    began: SE2
    cells: Cells
    shift: Steps
    low: Steps
    high: Steps
    move: SE2 = field(default_factory=SE2)
    drawn: SE2 = field(default_factory=SE2)
    corners: Cells = field(init=False)

    def __post_init__(self) -> None:
        self.corners = np.zeros((4, 2), np.int32)
        if len(self.cells):
            (left, low), (right, high) = self.cells.min(axis=0), self.cells.max(axis=0)
            self.corners[:] = (left, low), (right, high), (left, high), (right, low)

    def __len__(self) -> int:
        return len(self.cells)

    @property
    def pose(self) -> SE2:
        """Where it began, in the current map."""
        return self.move @ self.began


def moved_m(patches: Sequence[Patch], cell_m: float) -> float:
    """Greatest distance along an axis that a corner of any patch moved since it was drawn, m."""
    points = np.zeros((4 * len(patches), 3))
    points[:, :2] = np.array([patch.corners for patch in patches]).reshape(-1, 2) * cell_m
    now, drawn = (
        composed(np.repeat(np.array([pose.vector() for pose in poses]).reshape(-1, 3), 4, axis=0), points)[:, :2]
        for poses in ([patch.move for patch in patches], [patch.drawn for patch in patches])
    )
    return float(np.abs(now - drawn).max(initial=0.0))


def placed(cells: Cells, move: SE2, cell_m: float) -> Cells:
    """Cells (N, 2) after a move of their map; duplicates are possible."""
    if move == SE2():
        return cells
    return np.floor(move.apply((cells + 0.5) * cell_m) / cell_m).astype(np.int32)


def joined(first: Patch, second: Patch, cell_m: float) -> Patch:
    """Two patches as one: at the place of the first, with the evidence of both in sequence."""
    other = placed(second.cells, first.move.inverse() @ second.move, cell_m)
    cells = np.concatenate([first.cells, other])
    keys, one_of, place = np.unique(packed(cells), return_index=True, return_inverse=True)
    ours, theirs = place[: len(first)], place[len(first) :]
    limits = np.iinfo(np.int16)
    shift = np.zeros(len(keys), np.int16)
    low, high = np.full(len(keys), limits.min, np.int16), np.full(len(keys), limits.max, np.int16)
    shift[ours], low[ours], high[ours] = first.shift, first.low, first.high
    _, one = np.unique(theirs, return_index=True)  # two cells of a turned patch may lie on one
    at, later = theirs[one], (second.shift[one], second.low[one], second.high[one])
    shift[at], low[at], high[at] = after((shift[at], low[at], high[at]), later)
    return Patch(first.stamp_s, first.began, cells[one_of], shift, low, high, first.move, first.drawn)


def packed(cells: Cells) -> NDArray[np.int64]:
    """One number (N,) for each cell (N, 2)."""
    return cells.astype(np.int64) @ np.array([1, 1 << 32])


def after(before: Sequence[Steps], later: Sequence[Steps]) -> tuple[Steps, Steps, Steps]:
    """Two functions `clip(x + shift, low, high)` in turn, as one: its shift, low and high."""
    shift, low, high = later
    bounds = [np.clip(bound.astype(np.int32) + shift, low, high).astype(np.int16) for bound in before[1:]]
    total = np.clip(before[0].astype(np.int32) + shift, -20_000, 20_000).astype(np.int16)
    return total, bounds[0], bounds[1]


def columns_rows(points_m: Array, cell_m: float) -> Cells:
    """The cells (N, 2) that hold points (N, 2) of the map."""
    return np.floor(points_m / cell_m).astype(np.int32)


def summed(free: Sequence[Evidence], occupied: Sequence[Evidence]) -> tuple[Cells, Steps]:
    """The distinct cells (N, 2) of one picture's evidence, and the change of each one's log-odds in steps (N,): of each
    kind the strongest counts."""
    every = np.concatenate([np.zeros((0, 2), np.int32), *(cells for cells, _ in (*free, *occupied))])
    if not len(every):
        return every, np.zeros(0, np.int16)
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
    _, first, counts = np.unique(packed(cells), return_index=True, return_counts=True)
    return cells[first[counts > 1]]
