"""Plays a file camera at the speed of its stamps."""

import time
from collections.abc import Callable

from edgemap.runtime.cameras.around import CameraAround
from edgemap.runtime.cameras.fault import FrameTimeout
from edgemap.runtime.cameras.protocol import Camera
from edgemap.runtime.frame import Frame

TICK_S = 0.5  # longest wait of a read


class PacedCamera(CameraAround):
    """Delivers every frame of a file camera, none before its time has come; a slow reader gets them late.

    clock_s, sleep: seconds that only go forward, and waiting them; tests pass their own.
    """

    def __init__(
        self,
        camera: Camera,
        clock_s: Callable[[], float] = time.monotonic,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        super().__init__(camera)
        self._clock_s, self._sleep = clock_s, sleep
        self._start_s: float | None = None
        self._ahead: Frame | None = None

    def read(self) -> Frame | None:
        """The next frame, once its stamp has come; None at the end. Raises FrameTimeout where that takes longer."""
        frame, self._ahead = self._ahead or super().read(), None
        if frame is None:
            return None
        if self._start_s is None:
            self._start_s = self._clock_s() - frame.stamp_s
        wait_s = self._start_s + frame.stamp_s - self._clock_s()
        if wait_s > 0:
            self._sleep(min(wait_s, TICK_S))
        if wait_s > TICK_S:  # who reads has other things to do, such as to stop
            self._ahead = frame
            raise FrameTimeout(f"{self.name}: the next frame is {wait_s:.1f} s ahead", None, self.state)
        return frame
