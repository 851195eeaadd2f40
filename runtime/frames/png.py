"""Pictures as PNG files, for notebooks and reports."""

import numpy as np
from numpy.typing import NDArray


def png(picture: NDArray[np.uint8]) -> bytes:
    """A BGR picture (H, W, 3), or one with transparency (H, W, 4), as a PNG file."""
    import cv2

    return cv2.imencode(".png", picture)[1].tobytes()
