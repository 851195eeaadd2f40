"""Validation of the values that third-party cameras and drivers return."""

import math
from collections.abc import Callable
from numbers import Real
from typing import Any

import numpy as np
from numpy.typing import NDArray

from edgemap.runtime.frames.camera import Picture
from edgemap.runtime.frames.errors import CameraError, CameraFault
from edgemap.runtime.frames.faults import FaultKind
from edgemap.runtime.frames.reading import one_line

LARGEST_SIDE = 65_536  # px
LARGEST_RATE_HZ = 1e4
LARGEST_STAMP_S = 1e11  # a float has microseconds up to there


def stamp_of(given: Any) -> float:
    """A stamp in seconds; NaN where it is not a number, or so large (nanoseconds, milliseconds since 1970) that frames
    could not be distinguished.
    """
    if isinstance(given, bool) or not isinstance(given, Real):
        return math.nan
    try:
        stamp_s = float(given)
    except (OverflowError, ValueError):
        return math.nan
    return stamp_s if abs(stamp_s) < LARGEST_STAMP_S else math.nan


def picture_of(given: Any) -> Picture:
    """The result of `Device.grab` as a Picture, parts unchecked. Raises CameraError unless it has two or three."""
    if isinstance(given, Picture):
        return given
    if not isinstance(given, tuple | list) or len(given) not in (2, 3):
        raise CameraError(f"a grab gave a {type(given).__name__}, not (stamp_s, image) or a Picture")
    return Picture(*given)


def depth_of(given: Any, shape: tuple[int, int]) -> NDArray[np.float32] | None:
    """Depth of a picture of (height, width): metres, 0 where it is unknown, infinite or negative. Raises CameraError
    unless it is a numeric array of that shape.
    """
    if given is None:
        return None
    if not isinstance(given, np.ndarray) or given.dtype.kind not in "fiu" or given.shape != shape:
        what = f"{given.dtype} {given.shape}" if isinstance(given, np.ndarray) else type(given).__name__
        raise CameraError(f"depth is {what}, not numbers (H, W) of the picture's {shape[1]}x{shape[0]} px")
    with np.errstate(over="ignore"):  # what is beyond float32 is infinite there
        depth = given.astype(np.float32, copy=False)
    known = depth > 0.0  # false of NaN
    known &= depth < np.float32(np.inf)
    return depth if known.all() else np.where(known, depth, np.float32(0.0))


def size_of(given: Any, name: str) -> tuple[int, int]:
    """(width, height) in px of a camera or device. Raises CameraError."""
    try:
        width, height = (int(side) for side in given)
    except (TypeError, ValueError, OverflowError):
        width = height = 0
    if not (1 <= width <= LARGEST_SIDE and 1 <= height <= LARGEST_SIDE):
        raise CameraError(f"camera {name}: its size is {one_line(repr(given), 60)}, not (width, height) in pixels")
    return width, height


def rate_of(given: Any) -> float | None:
    """A nominal frame rate in Hz; None where the value is invalid."""
    rate = stamp_of(given)
    return rate if 0.0 < rate <= LARGEST_RATE_HZ else None


class PictureCheck:
    """Checks the pictures of one camera. A fault that lasts several pictures is reported once, when it begins.

    size: (width, height) in px that every picture must have. report: called with each fault.
    """

    def __init__(self, name: str, size: tuple[int, int], report: Callable[[CameraFault], None]) -> None:
        self._name, self._size, self._report = name, size, report
        self._before: set[FaultKind] = set()
        self._now: set[FaultKind] = set()

    def begin(self) -> None:
        """The faults from now on are of the next picture."""
        self._before, self._now = self._now, set()

    def note(self, kind: FaultKind, text: str) -> None:
        """A fault of this picture."""
        if kind not in self._before | self._now:
            self._report(CameraFault(kind, f"camera {self._name}: {text}"))
        self._now.add(kind)

    def picture(
        self, given: Any, depth: Any, grey: bool = False
    ) -> tuple[NDArray[np.uint8], NDArray[np.float32] | None] | None:
        """The picture as BGR, (H, W, 3), and its depth, without one where it is invalid; None for an invalid picture.
        grey: whether one of a single channel is taken, with a fault."""
        try:
            image = np.asarray(given)
        except Exception as error:  # a ragged list, or whatever an object's own conversion raises
            self.note(FaultKind.FORMAT, f"picture is a {type(given).__name__} that is no array ({one_line(error, 60)})")
            return None
        if grey and image.dtype == np.uint8 and (image.ndim == 2 or (image.ndim == 3 and image.shape[2] == 1)):
            self.note(FaultKind.GREY, "picture has one channel")
            image = np.repeat(image.reshape(*image.shape[:2], 1), 3, axis=2)
        if image.dtype != np.uint8 or image.ndim != 3 or image.shape[2] != 3:
            self.note(FaultKind.FORMAT, f"picture is {image.dtype} {image.shape}, not uint8 (H, W, 3)")
            return None
        height, width = image.shape[:2]
        if (width, height) != self._size:
            self.note(FaultKind.SIZE, f"picture is {width}x{height}, not {self._size[0]}x{self._size[1]} px")
            return None
        try:
            return image, depth_of(depth, (height, width))
        except CameraError as error:
            self.note(FaultKind.FORMAT, f"{error}; left out")
            return image, None
