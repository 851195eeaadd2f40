"""Cameras through OpenCV: a USB camera by V4L2, and a network camera, `rtsp://` or `http(s)://`, by FFmpeg."""

import os
import time
from pathlib import Path

import cv2
import numpy as np

from edgemap.geometry.camera.intrinsics import Intrinsics
from edgemap.runtime.frames.camera import Driver, Picture
from edgemap.runtime.frames.errors import CameraError
from edgemap.runtime.frames.limits import PATIENCE_S, SILENCE_S
from edgemap.runtime.frames.reading import library_path, without_secrets


class CaptureDevice:
    """An open `cv2.VideoCapture`. Stamps are its own where it has a clock, else the host's monotonic one."""

    intrinsics: Intrinsics | None = None

    def __init__(self, capture: cv2.VideoCapture, name: str) -> None:
        self._capture, self._name = capture, name
        self.rate_hz: float | None = capture.get(cv2.CAP_PROP_FPS)
        width, height = capture.get(cv2.CAP_PROP_FRAME_WIDTH), capture.get(cv2.CAP_PROP_FRAME_HEIGHT)
        self.size = (int(width), int(height))
        self._device_clock: bool | None = None

    def grab(self) -> Picture:
        """The next picture. Raises CameraError where none comes; from a stream, within `PATIENCE_S`."""
        good, image = self._capture.read()
        if not good or image is None:
            raise CameraError(f"{self._name} gives no picture (unplugged?)")
        stamp_s = self._capture.get(cv2.CAP_PROP_POS_MSEC) / 1000.0
        if self._device_clock is None:  # decided once: two clocks must not mix
            self._device_clock = stamp_s > 0
        return Picture(stamp_s if self._device_clock else time.monotonic(), np.asarray(image, dtype=np.uint8))

    def close(self) -> None:
        """Releases the device."""
        self._capture.release()


class WebcamDriver(Driver):
    """`/dev/videoN`, at the size of the intrinsics if stated, else at the driver's default."""

    def __init__(self, device: Path, name: str, intrinsics: Intrinsics | None = None) -> None:
        self.name = name
        self._device, self._intrinsics = device, intrinsics

    def open(self) -> CaptureDevice:
        """Opens the device. Raises CameraError where it does not exist, access is denied, or it is not a camera."""
        device = self._device
        if not device.exists():
            others = ", ".join(sorted(str(path) for path in Path("/dev").glob("video*"))) or "none"
            raise CameraError(f"{device}: no such camera (video devices here: {others}; check the cable)")
        if not os.access(device, os.R_OK | os.W_OK):
            raise CameraError(f"{device}: no permission; add the user to the group `video` and log in again")
        capture = cv2.VideoCapture(library_path(device), cv2.CAP_V4L2)
        if not capture.isOpened():
            capture.release()
            raise CameraError(f"{device}: cannot be opened as a camera (in use by another program, or not a camera)")
        if self._intrinsics is not None:
            capture.set(cv2.CAP_PROP_FRAME_WIDTH, self._intrinsics.width)
            capture.set(cv2.CAP_PROP_FRAME_HEIGHT, self._intrinsics.height)
        capture.set(cv2.CAP_PROP_BUFFERSIZE, 1)
        return CaptureDevice(capture, str(device))


class StreamDriver(Driver):
    """Opens the address. Its password, where it has one, stays out of every message."""

    def __init__(self, url: str) -> None:
        self.name = without_secrets(url)
        self._url = url

    def open(self) -> CaptureDevice:
        """Connect, within `SILENCE_S`, and decode the header. Raises CameraError."""
        limits = [cv2.CAP_PROP_OPEN_TIMEOUT_MSEC, round(1e3 * SILENCE_S)]
        limits += [cv2.CAP_PROP_READ_TIMEOUT_MSEC, round(1e3 * PATIENCE_S)]  # FFmpeg's own would be 30 s
        capture = cv2.VideoCapture(library_path(self._url), cv2.CAP_FFMPEG, limits)
        if not capture.isOpened():
            capture.release()
            raise CameraError(f"{self.name}: no stream that FFmpeg reads (is the address right, and the camera on?)")
        return CaptureDevice(capture, self.name)
