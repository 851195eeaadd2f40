"""A depth picture as points before the camera."""

import numpy as np
from numpy.typing import NDArray

from edgemap.geometry.arrays import Array
from edgemap.geometry.camera.intrinsics import Intrinsics

EVERY_PX = 8  # points are taken this far apart
NEAREST_M, FARTHEST_M = 0.15, 6.0  # depth that these cameras measure well


class DepthPoints:
    """Points of the optical frame at a grid of a depth picture's pixels. lens: intrinsics of these pictures."""

    def __init__(self, lens: Intrinsics, every_px: int = EVERY_PX) -> None:
        self._grid = (slice(every_px // 2, None, every_px),) * 2
        v, u = np.mgrid[every_px // 2 : lens.height : every_px, every_px // 2 : lens.width : every_px]
        rays = lens.rays(np.column_stack([u.ravel(), v.ravel()]).astype(np.float64))
        self._rays = rays / rays[:, 2:]

    def of(self, depth: NDArray[np.float32]) -> Array:
        """(N, 3) metres: the pixels with a valid depth within reach. depth: (H, W) metres, 0 or NaN where unknown."""
        z = depth[self._grid].ravel().astype(np.float64)
        good = (z > NEAREST_M) & (z < FARTHEST_M)
        return self._rays[good] * z[good, None]
