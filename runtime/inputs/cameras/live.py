"""A live camera: a supervisor on a separate thread, and a mailbox with one slot for the newest frame."""

import threading
import time
from collections import deque
from collections.abc import Callable

from edgemap.runtime.frames.camera import Camera, CameraInfo, CameraOptions, Driver, Picture, RecoveryRule
from edgemap.runtime.frames.errors import CameraFault, CameraLostError, CameraState, FrameTimeout
from edgemap.runtime.frames.frame import Frame
from edgemap.runtime.frames.limits import QUEUE, TICK_S
from edgemap.runtime.inputs.cameras.checked import rate_of, size_of
from edgemap.runtime.inputs.cameras.supervisor import Supervisor

HANG_LIMIT_S = 60.0  # a poll that lasts longer hangs in the driver, which only a new process gets out of


class LiveCamera(Camera):
    """The newest frame of a device, with recovery from its failures: see `Supervisor`.

    The thread overwrites the slot, so a slow reader skips frames and never sees an old one or one twice. The device is
    closed on the thread that grabs from it. clock_s, wait: a clock of the caller, on which everything then happens
    within `read`, without a thread. Raises what the driver's first `open` raises.
    """

    def __init__(
        self,
        driver: Driver,
        how: CameraOptions = CameraOptions(),  # noqa: B008
        clock_s: Callable[[], float] | None = None,
        wait: Callable[[float], object] | None = None,
    ) -> None:
        device = driver.open()
        size, rate_hz = size_of(device.size, driver.name), rate_of(device.rate_hz)
        lens = how.intrinsics or device.intrinsics
        super().__init__(CameraInfo(driver.name, size, lens, how.mount, live=True, rate_hz=rate_hz))
        self._clock_s = clock_s or time.monotonic
        self._changed = threading.Condition()
        self._faults: deque[CameraFault] = deque(maxlen=QUEUE)
        self._slot: Picture | None = None
        self._lost: BaseException | None = None
        self._closing = False
        self._supervisor = Supervisor(
            driver, device, size, self._faults.append, how.recovery or RecoveryRule(), self._clock_s, wait
        )
        self._polled_s = self._clock_s()
        self._thread: threading.Thread | None = None
        if clock_s is None:
            self._thread = threading.Thread(target=self._run, name=f"camera {self.info.name}", daemon=True)
            self._thread.start()

    @property
    def state(self) -> CameraState:
        """running, degraded or lost."""
        return self._supervisor.state if self._lost is None else CameraState.LOST

    @property
    def clock_offset_s(self) -> float:
        """From the device's stamps to those of the frames, s."""
        return self._supervisor.clock.offset_s

    def read(self) -> Frame | None:
        """The newest frame not yet delivered; None after `close`.

        Raises CameraFault for each fault before it, FrameTimeout after `TICK_S` without one, and CameraLostError for
        good.
        """
        with self._changed:
            until_s = self._clock_s() + TICK_S
            while True:
                if self._closing:
                    return None
                if self._faults:
                    raise self._faults.popleft()
                if self._slot is not None:
                    break
                if self._lost is not None:
                    raise self._lost
                now_s = self._clock_s()
                if now_s - self._polled_s > HANG_LIMIT_S:
                    raise CameraLostError(
                        f"camera {self.info.name}: its driver hangs, for {now_s - self._polled_s:.0f} s"
                    )
                if now_s >= until_s:
                    text = f"camera {self.info.name}: no frame within {TICK_S} s"
                    raise FrameTimeout(text, self._supervisor.clock.now_s(now_s), self.state)
                if self._thread is None:
                    self._poll()
                else:
                    self._changed.wait(until_s - now_s)
            picture, self._slot = self._slot, None
        if (measured_hz := self._supervisor.rate_hz) is not None:  # what a device states is often another rate
            self.update_info(rate_hz=measured_hz)
        return self.frame(picture.image, picture.stamp_s, f"{self.info.name}#{self._delivered}", picture.depth)

    def close(self) -> None:
        """Stops the thread and releases the device; waits at most `TICK_S` for a grab in progress."""
        with self._changed:
            self._closing = True
            self._slot = None
            self._changed.notify_all()
        self._supervisor.wake()
        if self._thread is None:
            self._supervisor.close()
        elif self._thread is not threading.current_thread():
            self._thread.join(timeout=TICK_S)

    def _poll(self) -> None:
        try:
            picture = self._supervisor.poll()
        except BaseException as error:  # passed to the reader, which must not wait for a thread that has ended
            self._lost = error
            picture = None
        with self._changed:
            self._polled_s = self._clock_s()
            if picture is not None and not self._closing:
                self._slot = picture
            if picture is not None or self._faults or self._lost:
                self._changed.notify_all()

    def _run(self) -> None:
        try:
            while not self._closing and self._lost is None:
                self._poll()
        finally:
            self._supervisor.close()
