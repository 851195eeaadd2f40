"""Cameras of a program: pictures from any iterable, and pictures that are pushed one by one."""

import math
import warnings
from collections.abc import Callable, Iterable, Iterator
from itertools import chain
from typing import Any

import numpy as np
from numpy.typing import NDArray

from edgemap.geometry.camera.imu import ImuSamples
from edgemap.geometry.camera.intrinsics import Intrinsics
from edgemap.geometry.camera.mount import Mount
from edgemap.geometry.errors import GeometryError
from edgemap.geometry.se2 import SE2
from edgemap.runtime.frames.camera import DEFAULT_RATE_HZ, CameraInfo, FileCamera, Picture, Pictures
from edgemap.runtime.frames.errors import CameraError
from edgemap.runtime.frames.frame import LARGEST_STAMP_S, Frame
from edgemap.runtime.frames.trajectory import GrowingTrack

Image = NDArray[np.uint8]
IntrinsicsLike = Intrinsics | tuple[float, float, float, float]
MountLike = Mount | tuple[float, float]


def as_intrinsics(
    value: IntrinsicsLike, width: int, height: int, where: str = "", warn: Callable[[str], object] = warnings.warn
) -> Intrinsics:
    """Intrinsics, or (fx, fy, cx, cy) in px of pictures of this size. where: for messages. Raises CameraError."""
    if isinstance(value, Intrinsics):
        return value
    where = where or f"intrinsics={value!r}"
    try:
        fx, fy, cx, cy = map(float, value)
        lens = Intrinsics(width, height, fx, fy, cx, cy)
    except GeometryError as error:
        raise CameraError(f"{where}: {error}") from None
    except (TypeError, ValueError):
        raise CameraError(f"{where}: expected four numbers, (fx, fy, cx, cy) in pixels") from None
    if lens.off_picture:
        raise CameraError(
            f"{where}: the principal point {lens.cx:g},{lens.cy:g} is outside the picture of {width}x{height} px "
            "(fx, fy, cx, cy: focal lengths first)"
        )
    if lens.doubt:
        warn(f"{where}: {lens.doubt}")
    return lens


def as_mount(value: MountLike) -> Mount:
    """A Mount, or (height_m, pitch_deg), pitch positive looking down. Raises CameraError or GeometryError."""
    if isinstance(value, Mount):
        return value
    try:
        height_m, pitch_deg = map(float, value)
    except (TypeError, ValueError):
        raise CameraError(f"mount={value!r}: expected a height in metres, or (height_m, pitch_deg)") from None
    return Mount.from_degrees(height_m, pitch_deg)


def as_picture(value: Any, name: str) -> Image:
    """A BGR picture, (H, W, 3) uint8. Raises CameraError with the type and shape that it has instead."""
    if not isinstance(value, np.ndarray) or value.dtype != np.uint8 or value.ndim != 3 or value.shape[2] != 3:
        raise CameraError(f"{name} is {described(value)}, expected a BGR picture: uint8 (height, width, 3)")
    return value


def described(value: Any) -> str:
    """What stands in place of a picture, for messages."""
    return f"{value.dtype} {value.shape}" if isinstance(value, np.ndarray) else type(value).__name__


class ProgramCamera(FileCamera):
    """Pictures of a program, whose stamps are seconds that rise.

    Milliseconds or nanoseconds show as pauses between all of the first pictures.
    """

    PAUSE_S, PAUSES = 10.0, 3  # so long, and so many before any shorter one: no drive's pictures
    _seconds = False  # whether a pause was shorter

    def _stamp(self, value: Any, name: str) -> float:
        """A stamp in seconds after that of the last frame. Raises CameraError."""
        try:
            stamp_s = float(value)
        except (TypeError, ValueError):
            stamp_s = math.nan
        if not math.isfinite(stamp_s) or stamp_s <= self._last_s:
            raise CameraError(f"{name}={value!r}: expected seconds after the picture before, {self._last_s}")
        pause_s = stamp_s - self._last_s
        self._seconds |= pause_s <= self.PAUSE_S
        if abs(stamp_s) > LARGEST_STAMP_S or (not self._seconds and self._delivered >= self.PAUSES):
            raise CameraError(
                f"{name}={value!r}, {pause_s:g} s after the one before: stamps are seconds, not milliseconds or "
                "nanoseconds"
            )
        return stamp_s


class FramesCamera(ProgramCamera):
    """The pictures of an iterable, in order: BGR arrays, or (stamp_s, BGR array) pairs.

    Those without stamps come ten a second. Raises CameraError where there is no picture, or the first is not an image.
    """

    def __init__(self, frames: Iterable[Image | tuple[float, Image]]) -> None:
        pictures: Iterator[Any] = iter(frames)
        try:
            first = next(pictures)
        except StopIteration:
            raise CameraError("frames= has no picture") from None
        height, width = _timed(first, 0)[1].shape[:2]
        count = len(frames) if hasattr(frames, "__len__") else None  # type: ignore[arg-type]
        info = CameraInfo("frames", (width, height), rate_hz=DEFAULT_RATE_HZ, frame_count=count)
        super().__init__(info, self._checked(chain([first], pictures)))

    def _checked(self, values: Iterable[Any]) -> Pictures:
        """The pictures. Raises CameraError at one that is none."""
        for number, value in enumerate(values):
            stamp_s, image = _timed(value, number)
            name = f"frames[{number}]"
            yield Picture(self._stamp(stamp_s, f"{name}[0]"), image, name=name)


def _timed(value: Any, number: int) -> tuple[Any, Image]:
    """The stamp, unchecked, and the picture of an item. Raises CameraError."""
    if isinstance(value, tuple) and len(value) == 2:
        return value[0], as_picture(value[1], f"frames[{number}][1]")
    return number / DEFAULT_RATE_HZ, as_picture(value, f"frames[{number}]")


class PushedCamera(ProgramCamera):
    """One picture at a time from a program with a loop; without one it is at its end.

    size and sensors are known from the first picture on.
    """

    def __init__(self, intrinsics: IntrinsicsLike, mount: Mount) -> None:
        super().__init__(CameraInfo("pushed pictures", mount=mount), iter(()))
        self._given = intrinsics
        self._pending: Frame | None = None
        self._track: GrowingTrack | None = None

    def give(self, image: Any, stamp_s: float, imu: Any = None, wheels: Any = None) -> None:
        """Sets the picture that `read` returns next; see `Session.push`. Raises CameraError for an invalid one."""
        picture = as_picture(image, "image")
        height, width = picture.shape[:2]
        samples, pose = _samples(imu), None if wheels is None else _pose(wheels)
        size = self.info.size
        first = size == (0, 0)
        if not first and (width, height) != size:
            raise CameraError(f"image is {width}x{height}, the pictures before were {size[0]}x{size[1]}")
        if pose is not None and not first and self._track is None:
            raise CameraError("wheels= was not given with the first picture: give it with every one, or with none")
        lens = as_intrinsics(self._given, width, height) if first else self.info.intrinsics
        stamp_s = self._stamp(stamp_s, "stamp_s")  # last: a refused picture has no stamp
        if first:
            self._track = None if pose is None else GrowingTrack()
            self.update_info(size=(width, height), intrinsics=lens, wheel=self._track)
        if pose is not None and self._track is not None:
            self._track.push(stamp_s, pose)
        self.update_info(imu=samples)
        self._pending = self.frame(picture, stamp_s, "pushed picture")

    def read(self) -> Frame | None:
        """The pushed picture; None where there is none."""
        frame, self._pending = self._pending, None
        return frame


def _samples(value: Any) -> ImuSamples | None:
    """ImuSamples, or (N, 7): stamp_s, gyro x y z in rad/s, accelerometer x y z in m/s^2, optical axes."""
    if value is None or isinstance(value, ImuSamples):
        return value
    rows = np.asarray(value, dtype=np.float64)
    rows = rows.reshape(-1, 7) if rows.size == 0 else np.atleast_2d(rows)
    if rows.ndim != 2 or rows.shape[1] != 7 or not np.isfinite(rows).all():
        raise CameraError(
            f"imu= has shape {rows.shape}, expected finite (N, 7): stamp_s, gyro x y z, accelerometer x y z"
        )
    return ImuSamples(rows[:, 0], rows[:, 1:4], rows[:, 4:])


def _pose(value: Any) -> SE2:
    """SE2, or (x_m, y_m, yaw_rad) of the wheel odometry."""
    try:
        x_m, y_m, yaw_rad = map(float, value.vector() if isinstance(value, SE2) else value)
    except (TypeError, ValueError):
        x_m = y_m = yaw_rad = math.nan
    if not all(map(math.isfinite, (x_m, y_m, yaw_rad))):
        raise CameraError(f"wheels={value!r}: expected three finite numbers, (x_m, y_m, yaw_rad)")
    return SE2(x_m, y_m, yaw_rad)
