"""A video file as a camera: every frame, in order, with the file's own time."""

import math
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from edgemap.geometry.camera.intrinsics import Intrinsics
from edgemap.geometry.camera.mount import Mount
from edgemap.runtime.frames.errors import CameraError
from edgemap.runtime.frames.frame import Frame
from edgemap.runtime.frames.library_names import library_path
from edgemap.runtime.frames.quiet import bounded_memory, quietly
from edgemap.runtime.inputs.cameras.base import CameraBase
from edgemap.runtime.inputs.drives.pictures import PIXEL_LIMIT, readable_depth

# A header's frame count is an estimate in some containers; a file that lacks more than this was cut off.
MISSING_FRAMES, MISSING_SHARE = 3, 0.05
FALLBACK_RATE_HZ = 30.0
MEMORY_BYTES = 1 << 30  # that opening, or a single frame, may take beyond what the process has


class VideoCamera(CameraBase):
    """A video that OpenCV decodes. stamps_s: where given, the video must have exactly one frame for each.

    Else stamps are the file's, or last + 1 / fps where those do not increase. Memory is bounded, independent of the
    size that the file claims. Raises CameraError for no video, and for one of too many pixels.
    """

    def __init__(
        self,
        name: str,
        path: Path,
        intrinsics: Intrinsics | None = None,
        mount: Mount | None = None,
        stamps_s: Sequence[float] | None = None,
    ) -> None:
        super().__init__(name, intrinsics, mount)
        if not path.is_file():
            raise CameraError(f"{path}: no such file")
        self._path, self._stamps_s = path, stamps_s
        self._capture: cv2.VideoCapture | None = _open_quietly(path)
        if not self._capture.isOpened():
            self.close()
            raise CameraError(f"{path}: not a video that OpenCV reads ({path.stat().st_size} bytes)")
        wide, high = (int(self._capture.get(what)) for what in (cv2.CAP_PROP_FRAME_WIDTH, cv2.CAP_PROP_FRAME_HEIGHT))
        if wide * high > PIXEL_LIMIT:
            self.close()
            raise CameraError(f"{path}: video of {wide}x{high} px, at most {PIXEL_LIMIT:,} px are decoded")
        rate = self._capture.get(cv2.CAP_PROP_FPS)
        self.rate_hz = float(rate) if math.isfinite(rate) and 0.0 < rate <= 1000.0 else None
        announced = int(self._capture.get(cv2.CAP_PROP_FRAME_COUNT))
        self._announced = announced if 0 < announced < 1 << 31 else None
        self.frame_count = len(stamps_s) if stamps_s is not None else self._announced
        self._last_s = -math.inf
        self._ahead = self._decode()  # what the header says of the size may be turned by the rotation tag
        if self._ahead is None:
            self.close()
            raise CameraError(f"{path}: a video in which no frame can be decoded ({announced} announced)")
        height, width = self._ahead[0].shape[:2]
        self.size = (width, height)

    def read(self) -> Frame | None:
        """The next frame; None at the end. Raises CameraError, after the last good frame, where the file is cut off."""
        if self._capture is None:
            return None
        decoded, self._ahead = self._ahead or self._decode(), None
        if decoded is None:
            self._check_end()
            return None
        if self._stamps_s is not None and self._delivered >= len(self._stamps_s):
            raise CameraError(f"{self._path}: more frames than the {len(self._stamps_s)} poses beside it")
        image, file_stamp_s = decoded
        self._last_s = self._stamp(file_stamp_s)
        depth = readable_depth(self.depth[self._delivered]) if self.depth else None
        return self.frame(image, self._last_s, f"{self._path}#{self._delivered}", depth)

    def close(self) -> None:
        """Close the file."""
        if self._capture is not None:
            self._capture.release()
            self._capture = None

    def _decode(self) -> tuple[NDArray[np.uint8], float] | None:
        if self._capture is None:
            return None
        try:
            with quietly(), bounded_memory(MEMORY_BYTES):
                good, image = self._capture.read()
        except (cv2.error, MemoryError):
            return None
        if not good or image is None:
            return None
        return np.asarray(image, dtype=np.uint8), self._capture.get(cv2.CAP_PROP_POS_MSEC) / 1000.0

    def _stamp(self, file_stamp_s: float) -> float:
        if self._stamps_s is not None:
            return float(self._stamps_s[self._delivered])
        if math.isfinite(file_stamp_s) and file_stamp_s > self._last_s:
            return file_stamp_s
        return self._last_s + 1.0 / (self.rate_hz or FALLBACK_RATE_HZ)

    def _check_end(self) -> None:
        if self._stamps_s is not None and self._delivered < len(self._stamps_s):
            raise CameraError(
                f"{self._path}: ends after {self._delivered} frames, {len(self._stamps_s)} poses beside it"
            )
        allowed = max(MISSING_FRAMES, MISSING_SHARE * (self._announced or 0))
        if self._announced is not None and self._announced - self._delivered > allowed:
            raise CameraError(f"{self._path}: cut off, {self._delivered} of {self._announced} announced frames decoded")


def _open_quietly(path: Path) -> cv2.VideoCapture:
    # Without a named backend OpenCV also takes the path for a picture pattern.
    known = cv2.videoio_registry.getBackends()
    with quietly(), bounded_memory(MEMORY_BYTES):
        return cv2.VideoCapture(library_path(path), cv2.CAP_FFMPEG if cv2.CAP_FFMPEG in known else cv2.CAP_ANY)
