"""The floor mask of one picture, as the network's floor head predicts it."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.ndimage import map_coordinates

from edgemap.geometry.arrays import Array

Grid = NDArray[np.float32]


@dataclass(frozen=True, slots=True, eq=False)
class FloorMask:
    """Probability of floor over a whole picture, on a grid coarser than its pixels.

    floor: (rows, columns) float32 in 0..1; cell (r, c) covers the picture's columns from c * width / columns to
    (c + 1) * width / columns, counted from the outer edge of its first pixel, and rows likewise. width, height: of the
    picture, px. wall: of the same shape, or None where the network does not separate walls from other objects. Raises
    ValueError where the shapes disagree.
    """

    floor: Grid
    width: int
    height: int
    wall: Grid | None = None

    def __post_init__(self) -> None:
        if self.floor.ndim != 2 or self.floor.size == 0 or min(self.width, self.height) < 1:
            raise ValueError(f"floor mask {self.floor.shape} of a picture of {self.width}x{self.height} px")
        if self.wall is not None and self.wall.shape != self.floor.shape:
            raise ValueError(f"floor mask {self.floor.shape}, walls {self.wall.shape}")

    def at(self, points_px: ArrayLike) -> Array:
        """Probability of floor at points (N, 2) of the picture, (N,): bilinear between the cells' middles.

        Pixel centres are whole numbers, as in `Intrinsics`. 0 for points outside the picture and for NaN.
        """
        points = np.asarray(points_px, dtype=np.float64).reshape(-1, 2)
        edges = points + 0.5  # from the outer edge of the first pixel
        size = np.array([self.width, self.height], dtype=np.float64)
        inside = np.all((edges >= 0.0) & (edges <= size), axis=1)
        cells = (np.where(inside[:, None], edges, 0.0) * self.floor.shape[::-1] / size - 0.5).T
        values = map_coordinates(self.floor, cells[::-1], np.float64, order=1, mode="nearest")
        return np.where(inside, values, 0.0)

    def hidden_until(self, box: ArrayLike) -> float | None:
        """Row of the picture where floor begins below a box (4,) whose lower edge has none below it in any column: what
        is in between hides the foot. Median over the columns; the picture's height where no floor follows. None where
        floor is visible at the edge, or the mask ends there.
        """
        x0, _, x1, y1 = np.asarray(box, dtype=np.float64)
        rows, columns = self.floor.shape
        first = int(y1 * rows / self.height) + 1
        left, right = np.clip(np.array([x0, x1]) * columns / self.width, 0, columns - 1).astype(np.intp)
        below = self.floor[first:, left : right + 1] > 0.5
        if len(below) == 0 or below[0].any():
            return None
        begins = np.where(below.any(axis=0), below.argmax(axis=0), len(below))
        return float((first + np.median(begins)) * self.height / rows)
