"""`sensor_msgs/Image` and `CompressedImage` to BGR."""

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from edgemap.runtime.frames.errors import CameraError
from edgemap.runtime.frames.reading import one_line
from edgemap.runtime.inputs.drives.pictures import PIXEL_LIMIT, SIDE_LIMIT, decode_picture

# sensor_msgs/image_encodings: channels, and how OpenCV makes BGR of them (None: it is BGR).
ENCODINGS: dict[str, tuple[int, int | None]] = {
    "bgr8": (3, None),
    "8UC3": (3, None),
    "rgb8": (3, cv2.COLOR_RGB2BGR),
    "bgra8": (4, cv2.COLOR_BGRA2BGR),
    "rgba8": (4, cv2.COLOR_RGBA2BGR),
    "mono8": (1, cv2.COLOR_GRAY2BGR),
    "8UC1": (1, cv2.COLOR_GRAY2BGR),
    "yuv422": (2, cv2.COLOR_YUV2BGR_UYVY),
    "uyvy": (2, cv2.COLOR_YUV2BGR_UYVY),
    "yuv422_yuy2": (2, cv2.COLOR_YUV2BGR_YUYV),
    "yuyv": (2, cv2.COLOR_YUV2BGR_YUYV),
}
COMPRESSED = ("jpeg", "jpg", "png", "webp", "tiff", "bmp")


def raw_picture(message: Any, name: str) -> NDArray[np.uint8]:
    """A decoded `sensor_msgs/Image` as BGR, (H, W, 3). Raises CameraError for an encoding or a size that cannot be."""
    if message.encoding not in ENCODINGS:
        raise CameraError(
            f"{name}: Image encoding {one_line(message.encoding, 40)!r} is not supported "
            f"(understood: {', '.join(ENCODINGS)})"
        )
    channels, conversion = ENCODINGS[message.encoding]
    height, width, step = int(message.height), int(message.width), int(message.step)
    if (
        height * width > PIXEL_LIMIT
        or max(height, width) > SIDE_LIMIT
        or (channels == 2 and width % 2)  # two pixels share their colour
        or not height
        or not width
        or step < width * channels
        or len(message.data) < height * step
    ):
        raise CameraError(
            f"{name}: Image of {width}x{height} px {message.encoding} with {len(message.data)} bytes in rows of {step}"
        )
    rows = np.frombuffer(message.data, np.uint8, height * step).reshape(height, step)
    image = rows[:, : width * channels].reshape(height, width, channels)
    if conversion is None:
        return image.copy()
    return np.asarray(cv2.cvtColor(np.ascontiguousarray(image), conversion), dtype=np.uint8)


def compressed_picture(message: Any, name: str) -> NDArray[np.uint8]:
    """A decoded `sensor_msgs/CompressedImage` as BGR, (H, W, 3).

    format: `jpeg`, `png`, or image_transport's `rgb8; jpeg compressed bgr8`. Raises CameraError for others (depth,
    video codecs) and for damaged pictures.
    """
    words = message.format.lower().replace(";", " ").split()
    if "compresseddepth" in words or (words and not set(words) & set(COMPRESSED)):
        raise CameraError(
            f"{name}: CompressedImage format {one_line(message.format, 40)!r} is not supported "
            f"(understood: {', '.join(COMPRESSED)})"
        )
    return decode_picture(bytes(message.data), name)
