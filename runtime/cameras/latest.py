"""The newest frame of a live device: a reader thread and a mailbox with one slot."""

from __future__ import annotations

import statistics
import threading
import time
from collections import deque
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from edgemap.geometry.camera.intrinsics import Intrinsics
from edgemap.geometry.camera.mount import Mount
from edgemap.runtime.cameras.base import CameraBase
from edgemap.runtime.errors import CameraError
from edgemap.runtime.frame import Frame

Picture = tuple[float, NDArray[np.uint8]]

FIRST_FRAME_LIMIT_S = 10.0  # devices wake slowly
SHORTEST_LIMIT_S = 1.0
INTERVALS_LIMIT = 10  # a device is dead after this many of its own median frame intervals
CLOCK_JUMP_LIMIT_S = 1.0


class LatestFrameCamera(CameraBase):
    """A live camera. grab: blocks for the next (stamp_s, BGR picture), None for "nothing yet", raises when dead.

    size: (width, height) in px. The thread overwrites the slot, so a slow reader skips frames and never sees an
    old one or one twice. The stall limit is ten median frame intervals of the last thirty, at least 1 s; 10 s
    before the first frame.
    `close_device` is called once, on the reader thread, after the last grab: no device is closed under a grab.
    """

    def __init__(
        self,
        name: str,
        grab: Callable[[], Picture | None],
        close_device: Callable[[], None],
        size: tuple[int, int],
        intrinsics: Intrinsics | None = None,
        mount: Mount | None = None,
        rate_hz: float | None = None,
        first_frame_limit_s: float = FIRST_FRAME_LIMIT_S,
    ) -> None:
        super().__init__(name, intrinsics, mount)
        self.live, self.size, self.rate_hz = True, size, rate_hz
        self._grab, self._close_device = grab, close_device
        self._first_frame_limit_s = first_frame_limit_s
        self._changed = threading.Condition()
        self._slot: Picture | None = None
        self._failure: Exception | None = None
        self._closing = False
        self._intervals_s: deque[float] = deque(maxlen=30)
        self._arrived_s = time.monotonic()
        self._seen_any = False
        self._last_stamp_s = -np.inf
        self._thread = threading.Thread(target=self._run, name=f"camera {name}", daemon=True)
        self._thread.start()

    @property
    def stall_limit_s(self) -> float:
        """How long the device may stay silent before `read` raises, seconds."""
        if not self._seen_any:
            return self._first_frame_limit_s
        median_s = statistics.median(self._intervals_s) if self._intervals_s else 0.0
        return max(SHORTEST_LIMIT_S, INTERVALS_LIMIT * median_s)

    def read(self) -> Frame | None:
        """The newest frame not yet delivered, waiting for it; None after `close`.

        Raises CameraError where the device fails, its thread has ended, or it is silent beyond the stall limit.
        """
        with self._changed:
            while self._slot is None:
                if self._closing:
                    return None
                if self._failure is not None:
                    raise self._failure
                limit_s = self.stall_limit_s
                silent_s = time.monotonic() - self._arrived_s
                if silent_s >= limit_s:
                    raise CameraError(f"camera {self.name}: no frame for {silent_s:.1f} s (limit {limit_s:.1f} s)")
                self._changed.wait(limit_s - silent_s)
            (stamp_s, image), self._slot = self._slot, None
        if stamp_s <= self._last_stamp_s:
            if self._last_stamp_s - stamp_s > CLOCK_JUMP_LIMIT_S:
                raise CameraError(
                    f"camera {self.name}: its clock went back from {self._last_stamp_s:.3f} s to {stamp_s:.3f} s"
                )
            stamp_s = self._last_stamp_s + 1e-4  # a corrected device clock may step back a little
        self._last_stamp_s = stamp_s
        return self.frame(image, stamp_s, f"{self.name}#{self._delivered}")

    def close(self) -> None:
        """Stop the thread and let go of the device; waits at most 2 s for a grab under way."""
        with self._changed:
            self._closing = True
            self._slot = None
            self._changed.notify_all()
        if self._thread is not threading.current_thread():
            self._thread.join(timeout=2.0)

    def _run(self) -> None:
        try:
            while not self._closing:
                picture = self._grab()
                if picture is not None:
                    self._post(picture)
        except Exception as error:  # handed to the reader, who must not wait for a thread that is gone
            with self._changed:
                self._failure = error
                self._changed.notify_all()
        finally:
            self._close_device()

    def _post(self, picture: Picture) -> None:
        with self._changed:
            now_s = time.monotonic()
            if self._seen_any:
                self._intervals_s.append(now_s - self._arrived_s)
            self._arrived_s, self._seen_any = now_s, True
            if not self._closing:
                self._slot = picture
            self._changed.notify_all()
