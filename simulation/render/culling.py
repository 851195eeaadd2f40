"""Culling: batches outside the picture, and batches completely behind walls."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from edgemap.simulation.render.mesh import Array
from edgemap.simulation.render.view import NEAR_M


def in_view(corners: Array, clip_home: Array, walls_m: NDArray[np.float32] | None) -> tuple[NDArray[np.intp], Array]:
    """Indices of the boxes (N, 8, 3) that may be seen, and all boxes' mean optical depth (N,) in metres.

    walls_m: (rows, columns) optical depth of the bare walls in a small picture of the same view, first row on top;
    a box that lies behind them everywhere is left out.
    """
    clip = corners @ clip_home[:, :3].T + clip_home[:, 3]
    sides, depth = clip[..., :2], clip[..., 3]
    outside = np.all(sides < -depth[..., None], axis=1).any(axis=-1)
    outside |= np.all(sides > depth[..., None], axis=1).any(axis=-1)
    outside |= np.all(depth < NEAR_M, axis=1)
    if walls_m is not None:
        near = depth.min(axis=1)
        unsure = np.flatnonzero(~outside & (near > NEAR_M))
        flat = sides[unsure] / depth[unsure, :, None]
        size = np.array(walls_m.shape[::-1])
        # The picture's y points down here, as in `projection`, turned over.
        at = (flat + 1.0) / 2.0 * size
        low = np.clip(np.floor(at.min(axis=1)) - 1, 0, size - 1).astype(int)
        high = np.clip(np.ceil(at.max(axis=1)) + 1, 1, size).astype(int)
        for index, (c0, r0), (c1, r1) in zip(unsure, low, high, strict=True):
            outside[index] = walls_m[r0:r1, c0:c1].max() < near[index]
    return np.flatnonzero(~outside), np.maximum(depth, 0.0).mean(axis=1)
