"""Recovers one live camera after faults: reports late frames, retries, reopens, resets, backs off, finally gives up."""

import statistics
import threading
from collections import deque
from collections.abc import Callable, Iterator

from edgemap.runtime.frames.camera import Device, Driver, Picture, RecoveryRule
from edgemap.runtime.frames.errors import CameraFault, CameraLostError, CameraState
from edgemap.runtime.frames.faults import FaultKind
from edgemap.runtime.frames.limits import TICK_S
from edgemap.runtime.frames.reading import error_line
from edgemap.runtime.inputs.cameras.delivery import DeliveryCheck

STALL_INTERVALS = 10  # median frame intervals after which a frame is late
BACK_OFF_LIMIT_S = 30.0  # longest wait before a restart; so many seconds of frames restore one
RETRIES = 3  # of grabs that fail in a row, before the device is opened again


class Supervisor:
    """Reads frames from a device that its driver has opened, and reopens the device after a failure.

    Call `poll` from one thread only. size: (width, height) in px that pictures must have. report: called with each
    fault. clock_s: monotonic clock, s. wait: waits for a number of seconds or until `wake`. Tests pass other clock_s
    and wait.
    """

    def __init__(
        self,
        driver: Driver,
        device: Device,
        size: tuple[int, int],
        report: Callable[[CameraFault], None],
        rule: RecoveryRule,
        clock_s: Callable[[], float],
        wait: Callable[[float], object] | None,
    ) -> None:
        self.state = CameraState.RUNNING
        self._driver, self._report, self._clock_s, self._rule = driver, report, clock_s, rule
        self._wake = threading.Event()
        self._wait = wait or self._wake.wait
        self._device: Device | None = device
        self._check = DeliveryCheck(driver.name, size, report)
        self.clock = self._check.clock
        self._intervals_s: deque[float] = deque(maxlen=30)
        self._heard_s = clock_s()  # the latest frame or opening
        self._fresh = True  # no frame since the device was opened
        self._spent = 0.0  # restarts that frames have not restored
        self._due_s = 0.0  # when the next restart is due
        self._away_s = 0.0
        self._removed = False
        self._polls = self._pictures()
        driver.watch(self._changed)

    @property
    def rate_hz(self) -> float | None:
        """Rate of the latest frames; None before there are enough."""
        enough = len(self._intervals_s) == self._intervals_s.maxlen
        return 1.0 / max(statistics.fmean(self._intervals_s), 1e-3) if enough else None

    @property
    def _stall_limit_s(self) -> float:
        """Maximum time without a frame from the device, s."""
        if not self._intervals_s:
            return self._rule.first_frame_limit_s
        running = max(self._rule.stall_limit_s, STALL_INTERVALS * statistics.median(self._intervals_s))
        waking = min(self._rule.first_frame_limit_s, 3.0 * running * 2.0 ** max(0, round(self._spent) - 1))
        return waking if self._fresh else running

    def poll(self) -> Picture | None:
        """The next good picture, with its stamp on the stream clock; None if there is none yet.

        Blocks no longer than one opening and one grab, or `TICK_S`. Raises CameraLostError once the budget is spent.
        """
        return next(self._polls)

    def wake(self) -> None:
        """Ends a current wait. It may be called from any thread."""
        self._wake.set()

    def close(self) -> None:
        """Releases the device, on the polling thread."""
        device, self._device = self._device, None
        if device is not None:
            try:
                device.close()
            except BaseException as error:  # a removed device may fail to close; it counts as closed
                self._fault(FaultKind.FAILED, f"does not close: {error_line(error)}")

    def _changed(self, present: bool) -> None:
        self._removed = not present
        if present:
            self._due_s = 0.0
        self.wake()

    def _pictures(self) -> Iterator[Picture | None]:
        """What `poll` returns, one by one."""
        while True:
            if self._device is not None:
                yield from self._of_device(self._device)
            self.close()
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

    def _heard(self, now_s: float) -> None:
        if self.state is CameraState.DEGRADED:
            self.state = CameraState.RUNNING
            text = f"delivers again after {now_s - self._away_s:.1f} s"
            self._report(CameraFault(FaultKind.RECOVERED, f"camera {self._driver.name}: {text}"))
        if not self._fresh:
            self._intervals_s.append(now_s - self._heard_s)
            self._spent = max(0.0, self._spent - (now_s - self._heard_s) / BACK_OFF_LIMIT_S)
        self._heard_s, self._fresh = now_s, False

    def _reopen(self, now_s: float) -> None:
        if self._spent > self._rule.restarts - 1:
            raise CameraLostError(
                f"camera {self._driver.name}: lost, no frame for {now_s - self._away_s:.0f} s and "
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
        self.clock.restart()
        self._heard_s = self._clock_s()

    def _fault(self, kind: FaultKind, text: str) -> None:
        if self.state is CameraState.RUNNING:
            self.state, self._away_s = CameraState.DEGRADED, self._heard_s
        self._report(CameraFault(kind, f"camera {self._driver.name}: {text}"))
