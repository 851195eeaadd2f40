"""A live camera: a thread that recovers it after faults, and a mailbox with one slot for the newest frame."""

import statistics
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator

from edgemap.runtime.frames.camera import Camera, CameraInfo, CameraOptions, Device, Driver, Picture, RecoveryRule
from edgemap.runtime.frames.errors import CameraFault, CameraLostError, CameraState, FrameTimeout
from edgemap.runtime.frames.faults import FaultKind
from edgemap.runtime.frames.frame import Frame
from edgemap.runtime.frames.limits import QUEUE, TICK_S
from edgemap.runtime.frames.reading import error_line
from edgemap.runtime.inputs.cameras.checked import rate_of, size_of
from edgemap.runtime.inputs.cameras.delivery import DeliveryCheck

HANG_LIMIT_S = 60.0  # a poll that lasts longer hangs in the driver, which only a new process gets out of
STALL_INTERVALS = 10  # median frame intervals after which a frame is late
BACK_OFF_LIMIT_S = 30.0  # longest wait before a restart; so many seconds of frames restore one
RETRIES = 3  # of grabs that fail in a row, before the device is opened again


class LiveCamera(Camera):
    """The newest frame of a device, with recovery from its failures: reports late frames, retries, reopens, resets,
    backs off, finally gives up (`RecoveryRule`).

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
        self._driver, self._rule, self._clock_s = driver, how.recovery or RecoveryRule(), clock_s or time.monotonic
        self._changed = threading.Condition()
        self._faults: deque[CameraFault] = deque(maxlen=QUEUE)
        self._slot: Picture | None = None
        self._lost: BaseException | None = None
        self._closing = False
        self._polled_s = self._heard_s = self._clock_s()  # the latest poll; the latest frame or opening
        # The rest is the thread's.
        self._wake = threading.Event()
        self._wait = wait or self._wake.wait
        self._device: Device | None = device
        self._check = DeliveryCheck(driver.name, size, self._faults.append)
        self._intervals_s: deque[float] = deque(maxlen=30)
        self._fresh = True  # no frame since the device was opened
        self._spent = 0.0  # restarts that frames have not restored
        self._due_s = 0.0  # when the next restart is due
        self._away_s: float | None = None  # the latest frame before the camera was degraded; None while it is running
        self._removed = False
        self._polls = self._pictures()
        driver.watch(self._plugged)
        self._thread: threading.Thread | None = None
        if clock_s is None:
            self._thread = threading.Thread(target=self._run, name=f"camera {self.info.name}", daemon=True)
            self._thread.start()

    @property
    def state(self) -> CameraState:
        """running, degraded or lost."""
        running = CameraState.RUNNING if self._away_s is None else CameraState.DEGRADED
        return running if self._lost is None else CameraState.LOST

    @property
    def clock_offset_s(self) -> float:
        """From the device's stamps to those of the frames, s."""
        return self._check.clock.offset_s

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
                    raise FrameTimeout(text, self._check.clock.now_s(now_s), self.state)
                if self._thread is None:
                    self._poll()
                else:
                    self._changed.wait(until_s - now_s)
            picture, self._slot = self._slot, None
        if len(self._intervals_s) == self._intervals_s.maxlen:  # what a device states is often another rate
            self.update_info(rate_hz=1.0 / max(statistics.fmean(self._intervals_s), 1e-3))
        return self.frame(picture.image, picture.stamp_s, f"{self.info.name}#{self._delivered}", picture.depth)

    def close(self) -> None:
        """Stops the thread and releases the device; waits at most `TICK_S` for a grab in progress."""
        with self._changed:
            self._closing = True
            self._slot = None
            self._changed.notify_all()
        self._wake.set()
        if self._thread is None:
            self._release()
        elif self._thread is not threading.current_thread():
            self._thread.join(timeout=TICK_S)

    def _run(self) -> None:
        try:
            while not self._closing and self._lost is None:
                self._poll()
        finally:
            self._release()

    def _poll(self) -> None:
        """Waits no longer than one opening and one grab, or `TICK_S`, and puts the next picture into the slot."""
        try:
            picture = next(self._polls)
        except BaseException as error:  # passed to the reader, which must not wait for a thread that has ended
            self._lost = error
            picture = None
        with self._changed:
            self._polled_s = self._clock_s()
            if picture is not None and not self._closing:
                self._slot = picture
            if picture is not None or self._faults or self._lost:
                self._changed.notify_all()

    def _pictures(self) -> Iterator[Picture | None]:
        """The good pictures, with their stamps on the stream clock; None where there is none yet. Raises
        CameraLostError once the budget of restarts is spent."""
        while True:
            if self._device is not None:
                yield from self._of_device(self._device)
            self._release()
            restarts = round(self._spent)  # the first of a sequence is due at once
            self._due_s = self._clock_s() + min(BACK_OFF_LIMIT_S, TICK_S * 2.0 ** (restarts - 1) if restarts else 0.0)
            yield None
            while (now_s := self._clock_s()) < self._due_s:
                self._wake.clear()
                self._wait(min(TICK_S, self._due_s - now_s))
                yield None
            self._reopen(now_s)

    def _of_device(self, device: Device) -> Iterator[Picture | None]:
        """The same of an open device, until it is removed, keeps failing or is silent for too long."""
        failures, late_s = 0, None
        while not self._removed:
            begun_s = self._clock_s()
            try:
                picture = device.grab()
                now_s = self._clock_s()
                good = None if picture is None else self._check(picture, now_s)
            except BaseException as error:  # drivers raise what they like: cv2.error, OSError, SystemExit of a plugin
                failures += 1
                if failures == 1:
                    self._fault(FaultKind.FAILED, f"stopped delivering ({error_line(error)})")
                # A grab that ran into a time limit (of a network stream) has already taken the time of the retries.
                if failures > RETRIES or self._clock_s() - begun_s >= self._stall_limit_s:
                    return
                self._wait(0.05)
                yield None
                continue
            limit_s, silent_s = self._stall_limit_s, now_s - self._heard_s
            if good is not None:
                failures, late_s = 0, None
                self._heard(now_s)
            elif silent_s >= limit_s:
                if late_s is None:
                    late_s = now_s
                    self._fault(FaultKind.LATE, f"no frame for {silent_s:.1f} s (limit {limit_s:.1f} s)")
                # A running device has one more limit: this process itself may have stalled.
                if self._fresh or now_s - late_s >= limit_s:
                    return
            yield good
        self._removed = False
        self._fault(FaultKind.REMOVED, "was removed")

    @property
    def _stall_limit_s(self) -> float:
        """Maximum time without a frame from the device, s."""
        if not self._intervals_s:
            return self._rule.first_frame_limit_s
        running = max(self._rule.stall_limit_s, STALL_INTERVALS * statistics.median(self._intervals_s))
        waking = min(self._rule.first_frame_limit_s, 3.0 * running * 2.0 ** max(0, round(self._spent) - 1))
        return waking if self._fresh else running

    def _heard(self, now_s: float) -> None:
        if self._away_s is not None:
            text = f"delivers again after {now_s - self._away_s:.1f} s"
            self._away_s = None
            self._faults.append(CameraFault(FaultKind.RECOVERED, f"camera {self._driver.name}: {text}"))
        if not self._fresh:
            self._intervals_s.append(now_s - self._heard_s)
            self._spent = max(0.0, self._spent - (now_s - self._heard_s) / BACK_OFF_LIMIT_S)
        self._heard_s, self._fresh = now_s, False

    def _reopen(self, now_s: float) -> None:
        if self._spent > self._rule.restarts - 1:
            raise CameraLostError(
                f"camera {self._driver.name}: lost, no frame for {now_s - (self._away_s or 0.0):.0f} s and "
                f"{self._rule.restarts} restarts are spent"
            )
        self._spent += 1.0
        self._heard_s, self._fresh = now_s, True
        try:
            if round(self._spent) % 2 == 0:
                self._driver.reset()
            self._device = self._driver.open()
        except BaseException as error:  # as of a grab
            self._fault(FaultKind.CLOSED, f"does not open ({error_line(error)})")
            return
        self._removed = False
        self._check.clock.restart()
        self._heard_s = self._clock_s()

    def _release(self) -> None:
        """Releases the device, on the polling thread."""
        device, self._device = self._device, None
        if device is not None:
            try:
                device.close()
            except BaseException as error:  # a removed device may fail to close; it counts as closed
                self._fault(FaultKind.FAILED, f"does not close: {error_line(error)}")

    def _plugged(self, present: bool) -> None:
        """From any thread."""
        self._removed = not present
        if present:
            self._due_s = 0.0
        self._wake.set()

    def _fault(self, kind: FaultKind, text: str) -> None:
        if self._away_s is None:
            self._away_s = self._heard_s
        self._faults.append(CameraFault(kind, f"camera {self._driver.name}: {text}"))
