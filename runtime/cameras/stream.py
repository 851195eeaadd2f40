"""A network camera: `rtsp://` or `http(s)://`, through OpenCV's FFmpeg."""

from collections.abc import Callable
from urllib.parse import urlsplit

import cv2

from edgemap.runtime.cameras.device import Picture
from edgemap.runtime.cameras.webcam import CaptureDevice
from edgemap.runtime.errors import CameraError
from edgemap.runtime.quiet import quietly

OPEN_LIMIT_MS, READ_LIMIT_MS = 5000, 2000  # FFmpeg's own would be 30 s each


class StreamDevice(CaptureDevice):
    """A connection; what FFmpeg says of a stall is said in our own line."""

    def grab(self) -> Picture:
        """The next picture. Raises CameraError where none comes within `READ_LIMIT_MS`."""
        with quietly():
            return super().grab()


class StreamDriver:
    """Opens the address. Its password, where it has one, stays out of every message."""

    def __init__(self, url: str) -> None:
        try:
            host = urlsplit(url)
        except ValueError as error:  # `rtsp://[`
            raise CameraError(f"{url}: not an address ({error})") from None
        self.name = url.replace(f"{host.username}:{host.password}@", "") if host.password else url
        self._url = url

    def open(self) -> StreamDevice:
        """Connect, within 5 s, and decode the header. Raises CameraError."""
        limits = [cv2.CAP_PROP_OPEN_TIMEOUT_MSEC, OPEN_LIMIT_MS, cv2.CAP_PROP_READ_TIMEOUT_MSEC, READ_LIMIT_MS]
        with quietly():
            capture = cv2.VideoCapture(self._url, cv2.CAP_FFMPEG, limits)
        if not capture.isOpened():
            capture.release()
            raise CameraError(f"{self.name}: no stream that FFmpeg reads (is the address right, and the camera on?)")
        return StreamDevice(capture, self.name)

    def reset(self) -> bool:
        """There is none."""
        return False

    def watch(self, changed: Callable[[bool], None]) -> None:
        """A stream that ends says so by failing reads."""
