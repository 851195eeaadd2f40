"""Plays a file camera at the speed of its stamps."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Self

from edgemap.runtime.cameras.protocol import Camera
from edgemap.runtime.frame import Frame


class PacedCamera:
    """Delivers every frame of a file camera, none before its time has come; a slow reader gets them late.

    clock_s, sleep: seconds that only go forward, and waiting them; tests pass their own.
    """

    def __init__(
        self,
        camera: Camera,
        clock_s: Callable[[], float] = time.monotonic,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        self.name, self.live, self.size = camera.name, camera.live, camera.size
        self.intrinsics, self.mount = camera.intrinsics, camera.mount
        self.rate_hz, self.frame_count, self.truth = camera.rate_hz, camera.frame_count, camera.truth
        self._camera, self._clock_s, self._sleep = camera, clock_s, sleep
        self._start_s: float | None = None

    def read(self) -> Frame | None:
        """The next frame, once its stamp has come; None at the end."""
        frame = self._camera.read()
        if frame is None:
            return None
        if self._start_s is None:
            self._start_s = self._clock_s() - frame.stamp_s
        wait_s = self._start_s + frame.stamp_s - self._clock_s()
        if wait_s > 0:
            self._sleep(wait_s)
        return frame

    def close(self) -> None:
        """Close the camera behind it."""
        self._camera.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()
