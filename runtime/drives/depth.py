"""Depth pictures on disk."""

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from edgemap.runtime.drives.pictures import PICTURE_BYTES, decoded
from edgemap.runtime.errors import CameraError
from edgemap.runtime.reading import read_bytes

Depth = NDArray[np.float32]  # (H, W) metres along the optical axis, 0 where unknown


def read_depth(path: Path) -> Depth:
    """A 16-bit picture of millimetres. Raises CameraError."""
    image = decoded(read_bytes(path, PICTURE_BYTES, CameraError), str(path), cv2.IMREAD_UNCHANGED)
    if image is None or image.dtype != np.uint16 or image.ndim != 2:
        raise CameraError(f"{path}: not a depth picture (one channel of 16 bits, millimetres)")
    return image.astype(np.float32) / np.float32(1000.0)


def readable_depth(path: Path | None) -> Depth | None:
    """The same; None where there is none that can be read: depth is never needed."""
    try:
        return None if path is None else read_depth(path)
    except CameraError:
        return None
