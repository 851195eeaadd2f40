"""A USB camera through V4L2: the newest frame."""

from __future__ import annotations

import math
import os
import time
from pathlib import Path

import cv2
import numpy as np

from edgemap.geometry.camera.intrinsics import Intrinsics
from edgemap.geometry.camera.mount import Mount
from edgemap.runtime.cameras.latest import LatestFrameCamera, Picture
from edgemap.runtime.errors import CameraError

MISSES_LIMIT = 5


def open_webcam(
    device: Path, name: str, intrinsics: Intrinsics | None = None, mount: Mount | None = None
) -> LatestFrameCamera:
    """Open `/dev/videoN`, at the intrinsics' size where they are given, else at the driver's default.

    Stamps are the driver's (its monotonic clock), or the host's monotonic clock where it gives none.
    Raises CameraError where there is no such device, it may not be opened, or it is no camera.
    """
    if not device.exists():
        others = ", ".join(sorted(str(path) for path in Path("/dev").glob("video*"))) or "none"
        raise CameraError(f"{device}: no such camera (video devices here: {others}; check the cable)")
    if not os.access(device, os.R_OK | os.W_OK):
        raise CameraError(f"{device}: no permission; add the user to the group `video` and log in again")
    capture = cv2.VideoCapture(str(device), cv2.CAP_V4L2)
    if not capture.isOpened():
        capture.release()
        raise CameraError(f"{device}: cannot be opened as a camera (in use by another program, or not a camera)")
    if intrinsics is not None:
        capture.set(cv2.CAP_PROP_FRAME_WIDTH, intrinsics.width)
        capture.set(cv2.CAP_PROP_FRAME_HEIGHT, intrinsics.height)
    capture.set(cv2.CAP_PROP_BUFFERSIZE, 1)
    rate = capture.get(cv2.CAP_PROP_FPS)
    size = (int(capture.get(cv2.CAP_PROP_FRAME_WIDTH)), int(capture.get(cv2.CAP_PROP_FRAME_HEIGHT)))
    reader = _Reader(capture, device)
    rate_hz = float(rate) if math.isfinite(rate) and rate > 0 else None
    return LatestFrameCamera(name, reader.grab, capture.release, size, intrinsics, mount, rate_hz)


class _Reader:
    def __init__(self, capture: cv2.VideoCapture, device: Path) -> None:
        self._capture, self._device = capture, device
        self._misses = 0
        self._device_clock: bool | None = None

    def grab(self) -> Picture | None:
        good, image = self._capture.read()
        if not good or image is None:
            self._misses += 1
            if self._misses >= MISSES_LIMIT or not self._device.exists():
                raise CameraError(f"{self._device}: the camera stopped delivering (unplugged?)")
            return None
        self._misses = 0
        stamp_s = self._capture.get(cv2.CAP_PROP_POS_MSEC) / 1000.0
        if self._device_clock is None:  # decided once: two clocks must not mix
            self._device_clock = stamp_s > 0
        return (stamp_s if self._device_clock else time.monotonic()), np.asarray(image, dtype=np.uint8)
