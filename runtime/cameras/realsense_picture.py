"""One librealsense colour frame to BGR, whatever format it came in."""

from types import ModuleType
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from edgemap.runtime.errors import CameraError


def to_bgr(rs: ModuleType, frame: Any, name: str) -> NDArray[np.uint8]:
    """The frame's picture as BGR, (H, W, 3) uint8, its own copy. Raises CameraError for a format not known."""
    pixel_format = frame.get_profile().format()
    height, width = frame.get_height(), frame.get_width()
    data = np.frombuffer(memoryview(np.asanyarray(frame.get_data())).cast("B"), np.uint8)
    if pixel_format == rs.format.bgr8:
        return data.reshape(height, width, 3).copy()
    conversions = {
        rs.format.rgb8: (3, cv2.COLOR_RGB2BGR),
        rs.format.rgba8: (4, cv2.COLOR_RGBA2BGR),
        rs.format.bgra8: (4, cv2.COLOR_BGRA2BGR),
        rs.format.yuyv: (2, cv2.COLOR_YUV2BGR_YUYV),
        rs.format.uyvy: (2, cv2.COLOR_YUV2BGR_UYVY),
        rs.format.y8: (1, cv2.COLOR_GRAY2BGR),
    }
    if pixel_format == rs.format.mjpeg:
        image = cv2.imdecode(data, cv2.IMREAD_COLOR)
        if image is None:
            raise CameraError(f"{name}: a damaged MJPEG frame of {data.size} bytes")
        return np.asarray(image, dtype=np.uint8)
    if pixel_format not in conversions:
        raise CameraError(f"{name}: colour format {pixel_format.name} is not supported")
    channels, code = conversions[pixel_format]
    return np.asarray(cv2.cvtColor(data.reshape(height, width, channels), code), dtype=np.uint8)
