"""One picture with its stamp: the output of every camera and the input of the step."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from edgemap.geometry.camera.imu import ImuSamples
from edgemap.runtime.frames.errors import BridgeError

LARGEST_STAMP_S = 1e11  # a float has microseconds up to there; milliseconds since 1970 are more


@dataclass(frozen=True, slots=True, eq=False)
class Frame:
    """A picture from the camera.

    index: counts delivered frames from 0. stamp_s: seconds, from the sensor or the file, strictly increasing.
    image: (H, W, 3) uint8, BGR as OpenCV keeps it. name: where it came from, for messages.
    imu: inertial samples since the previous delivered frame, up to this stamp; none where the source has none.
    depth: (H, W) float32, metres along the optical axis of this picture's pixels, 0 where unknown; None without a depth
    camera.
    search: whether the detector runs on it (`run --rate`); a recording stores that.
    Raises ValueError where the image is not (H, W, 3) uint8, or the depth not (H, W).
    """

    index: int
    stamp_s: float
    image: NDArray[np.uint8]
    name: str = ""
    imu: ImuSamples = field(default_factory=ImuSamples.none)
    depth: NDArray[np.float32] | None = None
    search: bool = True

    def _repr_png_(self) -> bytes:
        """In a notebook: the picture."""
        return png(self.image)

    def __post_init__(self) -> None:
        if self.image.dtype != np.uint8 or self.image.ndim != 3 or self.image.shape[2] != 3:
            raise ValueError(f"frame image is {self.image.dtype} {self.image.shape}, expected uint8 (H, W, 3)")
        if self.depth is not None and self.depth.shape != self.image.shape[:2]:
            raise ValueError(f"frame depth is {self.depth.shape}, the image {self.image.shape[:2]}")


def png(picture: NDArray[Any], quickly: bool = False) -> bytes:
    """A picture as a PNG file: BGR (H, W, 3), with transparency (H, W, 4), or of one channel, 8 or 16 bits. quickly:
    with the least compression. Raises BridgeError where it cannot be."""
    import cv2

    return _encoded(".png", picture, [cv2.IMWRITE_PNG_COMPRESSION, 1] if quickly else [])


def jpeg(picture: NDArray[Any], quality: int = 95) -> bytes:
    """A BGR picture as a JPEG file. quality: 0 to 100. Raises BridgeError where it cannot be."""
    import cv2

    return _encoded(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, quality])


def _encoded(suffix: str, picture: NDArray[Any], options: list[int]) -> bytes:
    import cv2

    good, data = cv2.imencode(suffix, picture, options)
    if not good:
        raise BridgeError(f"OpenCV does not encode a picture of {picture.shape} as {suffix}")
    return data.tobytes()
