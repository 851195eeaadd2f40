"""Keeps libraries that read untrusted files off the terminal and within bounded memory."""

import os
import resource
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import cv2

LOG_SILENT = 0  # OpenCV's LOG_LEVEL_SILENT
STATM = Path("/proc/self/statm")  # its first number: pages of address space


@contextmanager
def quietly() -> Iterator[None]:
    """Keeps the log of OpenCV and FFmpeg silent while the block runs."""
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")
    logging: Any = getattr(cv2.utils, "logging", cv2)  # OpenCV before 4.10 keeps both functions at its top
    level = logging.getLogLevel()
    logging.setLogLevel(LOG_SILENT)
    try:
        yield
    finally:
        logging.setLogLevel(level)


@contextmanager
def bounded_memory(more_bytes: int) -> Iterator[None]:
    """Limit the process to this much address space beyond what it has; allocations over that fail as on a machine
    without memory. Holds for all threads; for one user at a time. No bound where the system reports no size."""
    soft, hard = resource.getrlimit(resource.RLIMIT_AS)
    try:
        limit = int(STATM.read_text().split(maxsplit=1)[0]) * resource.getpagesize() + more_bytes
    except OSError:
        limit = soft
    known = [value for value in (soft, hard, limit) if value != resource.RLIM_INFINITY]
    resource.setrlimit(resource.RLIMIT_AS, (min(known, default=resource.RLIM_INFINITY), hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_AS, (soft, hard))
