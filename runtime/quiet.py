"""OpenCV and FFmpeg kept off the terminal: what fails is said in our own line."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import cv2

LOG_SILENT = 0  # OpenCV's LOG_LEVEL_SILENT


@contextmanager
def quietly() -> Iterator[None]:
    """While the block lasts."""
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")
    logging: Any = getattr(cv2.utils, "logging", cv2)  # OpenCV before 4.10 keeps both functions at its top
    level = logging.getLogLevel()
    logging.setLogLevel(LOG_SILENT)
    try:
        yield
    finally:
        logging.setLogLevel(level)
