"""Checks what third-party cameras and drivers return: it becomes a frame, a fault or the end, never a traceback."""

import math
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from numbers import Real
from typing import Any

import numpy as np
from numpy.typing import NDArray

from edgemap.geometry.camera.imu import ImuSamples
from edgemap.geometry.errors import EdgemapError
from edgemap.runtime.frames.camera import DEFAULT_RATE_HZ, Camera, CameraInfo
from edgemap.runtime.frames.errors import CameraError, CameraFault, CameraState, FrameTimeout
from edgemap.runtime.frames.faults import FaultKind
from edgemap.runtime.frames.frame import LARGEST_STAMP_S, Frame
from edgemap.runtime.frames.program_camera import as_picture, described
from edgemap.runtime.frames.reading import THEIRS, error_line, one_line, printable

FAILURES = 100  # reads in a row without a frame, after which the camera is at its end


def stamp_of(value: Any) -> float:
    """A stamp in seconds; NaN where it is not a number, or so large that frames could not be distinguished."""
    with suppress(OverflowError, ValueError):
        if isinstance(value, Real) and not isinstance(value, bool) and abs(stamp_s := float(value)) < LARGEST_STAMP_S:
            return stamp_s
    return math.nan


def size_of(value: Any, name: str) -> tuple[int, int]:
    """(width, height) in px of a camera or device. Raises CameraError."""
    try:
        width, height = (int(side) for side in value)
    except (TypeError, ValueError, OverflowError):
        width = height = 0
    if width < 1 or height < 1:
        raise CameraError(f"camera {name}: its size is {one_line(repr(value), 60)}, not (width, height) in pixels")
    return width, height


def rate_of(value: Any) -> float | None:
    """A nominal frame rate in Hz; None where the value is invalid."""
    rate_hz = stamp_of(value)
    return rate_hz if 0.0 < rate_hz <= 1000.0 else None  # time bases of streams are faster


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

    def picture(self, value: Any, depth: Any) -> tuple[NDArray[np.uint8], NDArray[np.float32] | None] | None:
        """The picture as BGR, (H, W, 3), and its depth, None where it is invalid; None for an invalid picture."""
        try:
            image = as_picture(value, "picture")
        except CameraError as error:
            self.note(FaultKind.FORMAT, str(error))
            return None
        height, width = image.shape[:2]
        if (width, height) != self._size:
            self.note(FaultKind.SIZE, f"picture is {width}x{height}, not {self._size[0]}x{self._size[1]} px")
            return None
        return image, self._depth(depth, (height, width))

    def _depth(self, value: Any, shape: tuple[int, int]) -> NDArray[np.float32] | None:
        """Metres, 0 where it is unknown, infinite or negative."""
        if value is None:
            return None
        if not isinstance(value, np.ndarray) or value.dtype.kind not in "fiu" or value.shape != shape:
            self.note(FaultKind.FORMAT, f"depth is {described(value)}, not numbers {shape}; left out")
            return None
        with np.errstate(over="ignore"):  # what is beyond float32 is infinite there
            depth = value.astype(np.float32, copy=False)
        valid = (depth > 0.0) & (depth < np.float32(np.inf))
        return depth if valid.all() else np.where(valid, depth, np.float32(0.0))


class CheckedCamera(Camera):
    """A validated `Camera` of third-party code. Each error is reported once, as a fault, when it begins. A stamp that
    is not finite, or runs backwards, is replaced by the previous one plus a frame interval; invalid pictures and depths
    are dropped. After `FAILURES` reads in a row without a frame the camera is at its end.
    Raises CameraError for a camera without a size.
    """

    def __init__(self, camera: Any, name: str = "") -> None:
        """name: the SPEC that it was opened from; its own where empty."""
        super().__init__(_checked_info(camera, name))
        self._camera = camera
        self._ahead: Frame | None = None
        self._new: list[CameraFault] = []
        self._check = PictureCheck(self.info.name, self.info.size, self._new.append)
        self._failures, self._offset_s = 0, 0.0  # the latter from the camera's stamps, once its clock ran backwards

    @property
    def state(self) -> CameraState:
        """The camera's state, where it is a valid one."""
        with suppress(*THEIRS):
            return CameraState(self._camera.state)
        return CameraState.RUNNING

    def read(self) -> Frame | None:
        """The next frame; None at the end. Raises CameraFault once for each error, FrameTimeout while it lasts, and
        CameraError where the camera raises it or has failed for too long.
        """
        if not self._new and self._ahead is None:
            self._check.begin()
            try:
                if (value := self._camera.read()) is None:
                    return None
                self._ahead = self._checked(value)
            except EdgemapError:
                raise
            except THEIRS as error:
                self._check.note(FaultKind.FAILED, f"read raised {error_line(error)}")
            self._failures = 0 if self._ahead is not None else self._failures + 1
            if self._failures > FAILURES:
                raise CameraError(f"camera {self.info.name}: {FAILURES} reads in a row gave no picture")
        if self._new:
            raise self._new.pop(0)
        if self._ahead is None:
            raise FrameTimeout(f"camera {self.info.name}: no picture", None, self.state)
        frame, self._ahead = self._ahead, None
        return frame

    def close(self) -> None:
        """Close it; errors of its code are ignored."""
        with suppress(*THEIRS):
            self._camera.close()

    def _checked(self, value: Any) -> Frame | None:
        """A frame made of what was returned; None where it has no picture of this camera."""
        if not isinstance(value, Frame):
            self._check.note(FaultKind.FORMAT, f"read gave a {type(value).__name__}, not a Frame")
            return None
        if (picture := self._check.picture(value.image, value.depth)) is None:
            return None
        imu = value.imu
        if not isinstance(imu, ImuSamples) or not _sound(imu):
            self._check.note(FaultKind.FORMAT, "inertial samples are none, or not finite in order of time; left out")
            imu = ImuSamples.none()
        stamp_s = self._stamp(value.stamp_s)
        if self._offset_s:
            imu = replace(imu, stamps_s=imu.stamps_s + self._offset_s)  # the camera's clock is also theirs
        name = printable(value.name) if isinstance(value.name, str) else f"{self.info.name}#{self._delivered}"
        image, depth = picture
        frame = Frame(self._delivered, stamp_s, image, name, imu, depth, search=value.search is not False)
        self._delivered += 1
        return frame

    def _stamp(self, value: Any) -> float:
        """The stamp in seconds, where it is after the last one; else one frame interval after that, as are the stamps
        that follow one that ran backwards."""
        stamp_s = stamp_of(value) + self._offset_s
        if not stamp_s > self._last_s:  # NaN too
            kind = FaultKind.STAMP if math.isnan(stamp_s) else FaultKind.CLOCK
            text = f"stamp {one_line(repr(value), 40)} is no time after {self._last_s:.6g} s; one interval taken"
            self._check.note(kind, text)
            interval_s = 1.0 / (self.info.rate_hz or DEFAULT_RATE_HZ)
            next_s = self._last_s + interval_s if math.isfinite(self._last_s) else 0.0
            self._offset_s += 0.0 if math.isnan(stamp_s) else next_s - stamp_s
            stamp_s = next_s
        self._last_s = stamp_s
        return stamp_s


def _checked_info(camera: Any, name: str) -> CameraInfo:
    """What a camera states of itself. Raises CameraError."""
    try:
        info = camera.info
    except THEIRS as error:
        raise CameraError(f"camera {name}: its info raises {error_line(error)}") from None
    if not isinstance(info, CameraInfo):
        raise CameraError(f"camera {name}: its info is a {type(info).__name__}, not CameraInfo")
    name = name or str(info.name)
    return replace(info, name=name, size=size_of(info.size, name), rate_hz=rate_of(info.rate_hz))


def _sound(imu: ImuSamples) -> bool:
    arrays = (imu.stamps_s, imu.gyro_rad_s, imu.accel_m_s2)
    return all(np.isfinite(values).all() for values in arrays) and bool((np.diff(imu.stamps_s) > 0.0).all())
