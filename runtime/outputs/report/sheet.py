"""The coordinate frame that drawings of the map share: origin and scale."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

Points = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Sheet:
    """Origin and scale of a drawing: its corner in the map, m, and px per metre."""

    top_x_m: float
    left_y_m: float
    px_per_m: float
    width_px: float
    height_px: float

    def at(self, points_m: ArrayLike) -> Points:
        """Map positions (..., 2) in metres to drawing positions (right, down)."""
        points = np.asarray(points_m, dtype=np.float64)
        return np.stack([self.left_y_m - points[..., 1], self.top_x_m - points[..., 0]], axis=-1) * self.px_per_m
