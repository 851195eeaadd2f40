"""A depth picture as points before the camera."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from edgemap.geometry.arrays import Array
from edgemap.geometry.camera.intrinsics import Intrinsics

EVERY_PX = 8  # spacing of the points
PATCH_PX = 3  # half the side of the patch whose depths are one point's
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


def patch_depths(depth: NDArray[np.float32], pixels: NDArray[np.floating[Any]]) -> Array:
    """Depths (N,) at pixels (N, 2) of a picture (H, W) with holes: medians over a patch; NaN where less than half of it
    is valid, as the middle of what is left is not the pixel's. Pixels count from the picture's outer edge.
    """
    height, width = depth.shape
    columns, rows = np.clip(pixels.astype(np.intp), PATCH_PX, [width - 1 - PATCH_PX, height - 1 - PATCH_PX]).T
    offsets = np.arange(-PATCH_PX, PATCH_PX + 1)
    patch = depth[rows[:, None, None] + offsets[:, None], columns[:, None, None] + offsets].reshape(
        len(pixels), len(offsets) ** 2
    )
    valid = (patch > NEAREST_M) & (patch < FARTHEST_M)
    count = valid.sum(axis=1)
    patch = np.sort(np.where(valid, patch, np.inf), axis=1)
    middle = patch[np.arange(len(patch)), np.maximum(count - 1, 0) // 2]
    return np.where(2 * count > patch.shape[1], middle, np.nan).astype(np.float64)
