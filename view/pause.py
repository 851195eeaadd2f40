"""Pauses the run of a file source: frames wait, and the clock that paces them stops."""

import time
from collections.abc import Callable

from edgemap.runtime.frames.camera import Camera
from edgemap.runtime.frames.errors import FrameTimeout
from edgemap.runtime.frames.frame import Frame
from edgemap.runtime.inputs.cameras.wrappers import CameraAround

LOOK_EVERY_S, HELD_S = 0.05, 0.25  # while held: between two looks, and until the reader may do something else


class Pause:
    """A switch that any thread may turn, and the seconds that pass while it is off.

    clock_s: seconds that only go forward; tests pass others.
    """

    def __init__(self, clock_s: Callable[[], float] = time.monotonic) -> None:
        self._clock_s = clock_s
        self._lost_s = 0.0
        self._since_s: float | None = None

    @property
    def paused(self) -> bool:
        """Whether the run is held."""
        return self._since_s is not None

    def set(self, paused: bool) -> None:
        """Holds the run, or resumes it."""
        now_s = self._clock_s()
        if paused and self._since_s is None:
            self._since_s = now_s
        elif not paused and self._since_s is not None:
            self._lost_s += now_s - self._since_s
            self._since_s = None

    def running_s(self) -> float:
        """The clock, less all the time held."""
        since_s = self._since_s
        return (self._clock_s() if since_s is None else since_s) - self._lost_s


class PausableCamera(CameraAround):
    """A camera that gives no frame while the run is held. stopped: asked meanwhile; true ends the frames."""

    def __init__(self, camera: Camera, pause: Pause, stopped: Callable[[], bool]) -> None:
        super().__init__(camera)
        self._pause, self._stopped = pause, stopped
        self._kept: tuple[Frame | None] | None = None  # read before the run was held

    def read(self) -> Frame | None:
        """The next frame; None at the end or when stopped. Raises FrameTimeout while the run is held."""
        kept = (super().read(),) if self._kept is None else self._kept
        held_s = 0.0
        while self._pause.paused:
            if self._stopped():
                return None
            if held_s >= HELD_S:
                self._kept = kept
                raise FrameTimeout(f"{self.info.name}: held", None, self.state)
            time.sleep(LOOK_EVERY_S)  # not Event.wait: a signal handler may run in here and set the same event
            held_s += LOOK_EVERY_S
        self._kept = None
        return kept[0]
