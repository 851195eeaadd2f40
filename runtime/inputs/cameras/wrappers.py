"""Cameras around a camera: they change how its frames are read and keep everything else."""

import math
import time
from collections.abc import Callable
from dataclasses import replace
from operator import attrgetter
from typing import Any

import numpy as np

from edgemap.geometry.camera.mount import QUARTER_TURN
from edgemap.runtime.frames.camera import Camera
from edgemap.runtime.frames.errors import FrameTimeout
from edgemap.runtime.frames.faults import Fault
from edgemap.runtime.frames.frame import Frame
from edgemap.runtime.frames.limits import TICK_S


class CameraAround(Camera):
    """A camera that forwards everything to another one. Subclasses override `read`."""

    def __init__(self, camera: Camera) -> None:
        super().__init__(camera.info)
        self._camera = camera

    info = property(attrgetter("_camera.info"), doc="That of the wrapped camera.")
    state = property(attrgetter("_camera.state"), doc="That of the wrapped camera.")
    clock_offset_s = property(attrgetter("_camera.clock_offset_s"), doc="That of the wrapped camera.")

    def update_info(self, **changes: Any) -> None:
        """Changes that of the wrapped camera."""
        self._camera.update_info(**changes)

    def read(self) -> Frame | None:
        """The next frame of the wrapped camera."""
        return self._camera.read()

    def account(self) -> list[Fault]:
        """That of the wrapped camera."""
        return self._camera.account()

    def object_records(self) -> list[dict[str, Any]] | None:
        """The objects of the wrapped camera."""
        return self._camera.object_records()

    def close(self) -> None:
        """Close the wrapped camera."""
        self._camera.close()


class RotatedCamera(CameraAround):
    """A camera whose pictures are turned clockwise by 90, 180 or 270 degrees until they are upright, with their depth,
    intrinsics and inertial samples. The mount is that of the upright picture already."""

    info, update_info = Camera.info, Camera.update_info  # of the turned pictures

    def __init__(self, camera: Camera, degrees: int) -> None:
        super().__init__(camera)
        info, self._turns = camera.info, degrees // 90 % 4
        self._axes = np.linalg.matrix_power(QUARTER_TURN, self._turns)
        self.update_info(
            size=info.size[::-1] if self._turns % 2 else info.size,
            intrinsics=info.intrinsics and info.intrinsics.rotated(degrees),
            imu=info.imu and info.imu.rotated(self._axes),
            attitudes=None,
        )

    def read(self) -> Frame | None:
        """The next frame of the wrapped camera, turned."""
        frame = super().read()
        if frame is None:
            return None
        image, depth = (
            None if plane is None else np.ascontiguousarray(np.rot90(plane, -self._turns))
            for plane in (frame.image, frame.depth)
        )
        return replace(frame, image=image, depth=depth, imu=frame.imu.rotated(self._axes))


class PacedCamera(CameraAround):
    """Delivers every frame of a file camera at its stamp, never earlier; a slow reader receives them late.

    clock_s: a monotonic clock in seconds.
    """

    def __init__(self, camera: Camera, clock_s: Callable[[], float] = time.monotonic) -> None:
        super().__init__(camera)
        self._clock_s = clock_s
        self._start_s: float | None = None
        self._ahead: Frame | None = None

    def read(self) -> Frame | None:
        """The next frame at its stamp; None at the end. Raises FrameTimeout after TICK_S without one."""
        frame, self._ahead = self._ahead or super().read(), None
        if frame is None:
            return None
        if self._start_s is None:
            self._start_s = self._clock_s() - frame.stamp_s
        wait_s = self._start_s + frame.stamp_s - self._clock_s()
        if wait_s > 0:
            time.sleep(min(wait_s, TICK_S))
        if wait_s > TICK_S:  # so that a stop is noticed
            self._ahead = frame
            raise FrameTimeout(f"{self.info.name}: the next frame is {wait_s:.1f} s ahead", None, self.state)
        return frame


class SearchRate(CameraAround):
    """Marks the pictures that the network searches: those nearest to `rate_hz` a second, by their stamps alone, so that
    a replay searches the same. Motion is still estimated at every picture. rate_hz: positive."""

    def __init__(self, camera: Camera, rate_hz: float) -> None:
        super().__init__(camera)
        self._period_s = 1.0 / rate_hz
        self._due_s = self._last_s = -math.inf

    def read(self) -> Frame | None:
        """The next frame, marked."""
        frame = super().read()
        return frame and replace(frame, search=self._is_due(frame.stamp_s))

    def _is_due(self, stamp_s: float) -> bool:
        """Whether no later picture is nearer to the stamp that is due. A clock that was set back makes it due."""
        half_interval_s = 0.5 * (stamp_s - self._last_s) if math.isfinite(self._last_s) else 0.0
        self._last_s = stamp_s
        if stamp_s + half_interval_s < self._due_s <= stamp_s + 2.0 * self._period_s:
            return False
        next_s = self._due_s + self._period_s
        self._due_s = next_s if stamp_s < next_s <= stamp_s + 1.5 * self._period_s else stamp_s + self._period_s
        return True
