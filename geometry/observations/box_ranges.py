"""The range of the object in a box, from a depth picture."""

import numpy as np
from numpy.typing import NDArray

from edgemap.geometry.arrays import Array
from edgemap.geometry.camera.depth_points import NEAREST_M
from edgemap.geometry.camera.floor import FloorCamera

ACROSS, DOWN = (0.2, 0.8), (0.15, 0.9)  # of a box, its part that is read
SAMPLES = 14  # along each side of it
FARTHEST_M = 8.0
OFF_FLOOR_M, OFF_FLOOR_PER_M = 0.05, 0.01  # lower points are the floor's
KNOWN_SHARE = 0.25  # of the samples, above the floor and with measured depth
NEAR_QUANTILE = 0.3  # what shows through an object lies behind it
DEPTH_M, DEPTH_PER_M2 = 0.02, 0.004  # standard deviation of a measured range: constant, and with its square


def box_ranges(depth: NDArray[np.float32], boxes: Array, camera: FloorCamera) -> Array:
    """Horizontal range from the lens to the object in each box, and its standard deviation, (N, 2) m; NaN where
    unknown.

    depth: (H, W) metres along the optical axis, 0 or NaN where unknown. boxes: (N, 4), as of `Detections`.
    """
    ranges = np.full((len(boxes), 2), np.nan)
    if len(boxes) == 0:
        return ranges
    size = np.array([camera.intrinsics.width, camera.intrinsics.height], dtype=np.float64)
    low, high = np.clip(boxes[:, :2], 0.0, size), np.clip(boxes[:, 2:], 0.0, size)
    across, down = (np.linspace(*part, SAMPLES) for part in (ACROSS, DOWN))
    u = low[:, :1] + (high - low)[:, :1] * across
    v = low[:, 1:] + (high - low)[:, 1:] * down
    columns = np.clip(u.astype(np.intp), 0, camera.intrinsics.width - 1)
    rows = np.clip(v.astype(np.intp), 0, camera.intrinsics.height - 1)
    z = depth[rows[:, :, None], columns[:, None, :]].astype(np.float64).reshape(len(boxes), -1)
    pixels = np.stack(np.broadcast_arrays(columns[:, None, :], rows[:, :, None]), axis=-1).reshape(-1, 2)
    rays = camera.intrinsics.rays(pixels.astype(np.float64))
    along = (rays / rays[:, 2:]) @ camera.mount.rotation_base_optical().T
    points = along.reshape(len(boxes), -1, 3) * z[..., None]
    reach = np.hypot(points[..., 0], points[..., 1])
    heights = points[..., 2] + camera.mount.height_m
    measured = (z > NEAREST_M) & (z < FARTHEST_M) & (heights > OFF_FLOOR_M + OFF_FLOOR_PER_M * reach)
    for row in np.flatnonzero(measured.mean(axis=1) > KNOWN_SHARE):
        near_m = float(np.quantile(reach[row, measured[row]], NEAR_QUANTILE))
        ranges[row] = near_m, DEPTH_M + DEPTH_PER_M2 * near_m**2
    return ranges
