"""Motion blur and rolling shutter: the picture of one instant, moved along the flow that depth and motion give."""

import math
from functools import cache

import cv2
import numpy as np
from numpy.typing import NDArray

from edgemap.geometry.camera.intrinsics import Intrinsics
from edgemap.geometry.camera.mount import Mount
from edgemap.simulation.render.mesh import Array
from edgemap.simulation.render.view import NO_MAP

# Flow below this many pixels changes nothing that one sees.
_LEAST_PX = 1.0
_MOST_SAMPLES = 9
# The flow is smooth but for outlines: it is worked out on every fourth pixel.
_COARSE = 4
_FAR_M = 8.0


Twist = tuple[Array, Array]


def optical_twist(velocity: Array, mount: Mount) -> Twist:
    """Velocity (3,) m/s and rotation (3,) rad/s of the camera in its own optical axes.

    velocity: forward m/s, left m/s, yaw rad/s of the base.
    """
    rotation, arm = mount.rotation_base_optical(), mount.position_base_m()
    spin = np.array([0.0, 0.0, velocity[2]])
    linear = np.array([velocity[0], velocity[1], 0.0]) + np.cross(spin, arm)
    return linear @ rotation, spin @ rotation


def flow_px_s(depth_m: NDArray[np.float32], intrinsics: Intrinsics, linear: Array, spin: Array) -> NDArray[np.float32]:
    """How fast each pixel's point moves over the picture (H, W, 2), px/s (Longuet-Higgins and Prazdny 1980).

    Lens distortion is left out: it changes blur by a few per cent of its length.
    """
    rows, columns = depth_m.shape
    x = ((np.arange(columns, dtype=np.float32) - intrinsics.cx) / intrinsics.fx)[None, :]
    y = ((np.arange(rows, dtype=np.float32) - intrinsics.cy) / intrinsics.fy)[:, None]
    near = 1.0 / np.where(depth_m > 0.05, depth_m, np.float32(_FAR_M))
    across = (-linear[0] + x * linear[2]) * near + x * y * spin[0] - (1.0 + x * x) * spin[1] + y * spin[2]
    down = (-linear[1] + y * linear[2]) * near + (1.0 + y * y) * spin[0] - x * y * spin[1] - x * spin[2]
    return np.stack([across * intrinsics.fx, down * intrinsics.fy], axis=-1).astype(np.float32)


@cache
def _pixels(height: int, width: int) -> NDArray[np.float32]:
    """Column and row of every pixel, (H, W, 2)."""
    columns, rows = np.meshgrid(np.arange(width, dtype=np.float32), np.arange(height, dtype=np.float32))
    return np.stack([columns, rows], axis=-1)


def exposed(
    picture: NDArray[np.uint8],
    depth_m: NDArray[np.float32],
    intrinsics: Intrinsics,
    twist: Twist,
    exposure_s: float,
    readout_s: float,
) -> NDArray[np.uint8]:
    """The picture (H, W, 3) as a shutter open for a while, row after row, makes it; the middle row at its own instant.

    depth_m: (H, W), of the same instant. twist: as `optical_twist` gives it.
    """
    height, width = depth_m.shape
    thin = depth_m[_COARSE // 2 :: _COARSE, _COARSE // 2 :: _COARSE]
    coarse = intrinsics.scaled(thin.shape[1], thin.shape[0])
    flow = flow_px_s(np.ascontiguousarray(thin), coarse, *twist) * np.float32(_COARSE)
    fastest = float(np.percentile(np.abs(flow), 98))
    if fastest * max(exposure_s, 0.5 * readout_s) < _LEAST_PX:
        return picture
    flow = np.asarray(cv2.resize(flow, (width, height), interpolation=cv2.INTER_LINEAR))
    late_s = (((np.arange(height, dtype=np.float32) + 0.5) / height - 0.5) * readout_s)[:, None, None]
    start = _pixels(height, width) - flow * late_s
    count = min(_MOST_SAMPLES, max(1, math.ceil(fastest * exposure_s / 1.5)))
    moments_s = ((np.arange(count) + 0.5) / count - 0.5) * exposure_s
    total = np.zeros(picture.shape, dtype=np.float32)
    for moment_s in moments_s:
        source = start - flow * np.float32(moment_s)
        seen = cv2.remap(picture, source, NO_MAP, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        cv2.accumulate(seen, total)
    return np.asarray(cv2.convertScaleAbs(total, alpha=1.0 / count), dtype=np.uint8)
