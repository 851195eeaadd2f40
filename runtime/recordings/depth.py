"""Depth pictures in a recording: `sensor_msgs/CompressedImage` beside the pictures, at the same stamps, bit for bit.

16 bits where they hold every value, as ROS has it (REP 118: `16UC1`, millimetres) or in the finer unit that the format
names; else the four bytes of each float32.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from edgemap.runtime.drives.depth import Depth
from edgemap.runtime.drives.pictures import decoded
from edgemap.runtime.errors import CameraError
from edgemap.runtime.messages.topics import DEPTH
from edgemap.runtime.recordings.reader import McapReading

PER_METRE = 1000, 10000  # steps of a metre: of nearly every depth camera, and of the near-range ones
FLOATS = "32FC1 in bytes; png"


def encoded_depth(depth: Depth) -> tuple[bytes, str]:
    """PNG and format of a depth picture (H, W) in metres."""
    for steps in PER_METRE:
        with np.errstate(invalid="ignore"):
            raw = np.rint(depth * steps).astype(np.uint16)
        if np.array_equal(raw.astype(np.float32) / np.float32(steps), depth):
            return _png(raw), f"16UC1; {steps} a metre; png"
    return _png(np.ascontiguousarray(depth, dtype="<f4").view(np.uint8).reshape(*depth.shape, 4)), FLOATS


def decoded_depth(data: bytes, form: str, name: str) -> Depth:
    """The depth picture again, (H, W) metres. Raises CameraError."""
    image = decoded(data, name, cv2.IMREAD_UNCHANGED)
    steps = {f"16UC1; {steps} a metre; png": steps for steps in PER_METRE}.get(form)
    if image is not None and steps and image.dtype == np.uint16 and image.ndim == 2:
        return image.astype(np.float32) / np.float32(steps)
    if image is not None and form == FLOATS and image.dtype == np.uint8 and image.shape[2:] == (4,):
        return np.ascontiguousarray(image).view("<f4").reshape(image.shape[:2]).astype(np.float32, copy=False)
    raise CameraError(f"{name}: not a depth picture that edgemap recorded")


class RecordedDepth:
    """The depth pictures of a recording in order of time; one that is damaged is none: depth is never needed."""

    def __init__(self, recording: McapReading) -> None:
        self._messages: Iterator[tuple[int, Callable[[], Any]]] = recording.messages(DEPTH)
        self._ahead: tuple[int, Callable[[], Any]] | None = None

    def at(self, stamp_ns: int) -> Depth | None:
        """The one of a stamp, later than the last that was asked for; None where there is none."""
        waiting = [] if self._ahead is None else [self._ahead]
        self._ahead = None
        for found in itertools.chain(waiting, self._messages):
            if found[0] < stamp_ns:
                continue
            if found[0] > stamp_ns:
                self._ahead = found
                return None
            try:
                message = found[1]()
                depth = decoded_depth(bytes(message.data), message.format, DEPTH)
            except CameraError:
                return None
            return depth
        return None


def _png(picture: NDArray[Any]) -> bytes:
    done, data = cv2.imencode(".png", picture, [cv2.IMWRITE_PNG_COMPRESSION, 1])
    if not done:
        raise CameraError(f"a depth picture of {picture.shape[1]}x{picture.shape[0]} px cannot be written as PNG")
    return data.tobytes()
