"""A depth picture as points before the camera, and its depth at single pixels."""

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from edgemap.geometry.arrays import Array
from edgemap.geometry.camera.intrinsics import Intrinsics

EVERY_PX = 6  # at 3 m from a lens 0.6 m up 12 cm of floor, from one 1.6 m up 6 cm
NEAREST_M, FARTHEST_M = 0.15, 6.0  # depth that these cameras measure well


@dataclass(frozen=True, slots=True, eq=False)
class SparseDepth:
    """A subsampled depth picture, the form in which the back end gets depth. depth_m: (rows, columns) float32 along the
    optical axis, 0 or NaN where unknown, of the pixels at every_px // 2, every_px // 2 + every_px and so on of the
    picture, down and across."""

    depth_m: NDArray[np.float32]
    every_px: int = EVERY_PX

    @classmethod
    def of(cls, depth_m: NDArray[np.float32], every_px: int = EVERY_PX) -> "SparseDepth":
        """Subsamples a depth picture (H, W) registered to the camera's pixels."""
        first = every_px // 2
        return cls(depth_m[first::every_px, first::every_px].copy(), every_px)

    def points(self, lens: Intrinsics, farthest_m: float = FARTHEST_M) -> tuple[Array, Array]:
        """Points (N, 3) of the optical frame, metres, and their pixels (N, 2); nearer than farthest_m."""
        pixels, rays = _lattice(lens, self.every_px)
        depth = self.depth_m.ravel()
        with np.errstate(invalid="ignore"):
            good = np.flatnonzero((depth > NEAREST_M) & (depth < farthest_m))
        return rays[good] * depth[good, None].astype(np.float64), pixels[good]


def patch_depths(depth: NDArray[np.float32], pixels: NDArray[np.floating[Any]]) -> Array:
    """Depths (N,) at pixels (N, 2) of a picture (H, W) with holes: medians over a patch; NaN where less than half of it
    is valid, as the middle of what is left is not the pixel's. Pixels count from the picture's outer edge.
    """
    side = 7  # of a patch
    columns, rows = np.clip(pixels.astype(np.intp) - side // 2, 0, np.subtract(depth.shape[::-1], side)).T
    patch = sliding_window_view(depth, (side, side))[rows, columns].reshape(len(pixels), -1)
    valid = (patch > NEAREST_M) & (patch < FARTHEST_M)
    count = valid.sum(axis=1)
    patch = np.sort(np.where(valid, patch, np.inf), axis=1)
    middle = patch[np.arange(len(patch)), np.maximum(count - 1, 0) // 2]
    return np.where(2 * count > patch.shape[1], middle, np.nan).astype(np.float64)


@lru_cache(maxsize=4)
def _lattice(lens: Intrinsics, every_px: int) -> tuple[Array, Array]:
    """Pixels (N, 2) of the lattice and their rays (N, 3) with z = 1."""
    first = every_px // 2
    v, u = np.mgrid[first : lens.height : every_px, first : lens.width : every_px]
    pixels = np.column_stack([u.ravel(), v.ravel()]).astype(np.float64)
    return pixels, lens.rays(pixels)
