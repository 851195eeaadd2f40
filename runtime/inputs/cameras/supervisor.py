"""Recovers one live camera after faults: reports late frames, retries, reopens, resets, backs off, finally gives up."""

import statistics
import threading
import time
from collections import deque
from collections.abc import Callable

from edgemap.runtime.frames.camera import Device, Driver, Picture, RecoveryRule
from edgemap.runtime.frames.errors import CameraFault, CameraLostError, CameraState
from edgemap.runtime.frames.faults import FaultKind
from edgemap.runtime.frames.limits import TICK_S
from edgemap.runtime.frames.reading import error_line
from edgemap.runtime.inputs.cameras.checked import size_of
from edgemap.runtime.inputs.cameras.delivery import DeliveryCheck

STALL_INTERVALS = 10  # median frame intervals after which a frame is late
BACK_OFF_LIMIT_S = 30.0  # longest wait before a restart; so many seconds of frames restore one
RETRIES = 3  # of grabs that fail in a row, before the device is opened again


class Supervisor:
    """Reads frames from a device that its driver has opened, and reopens the device after a failure.

    Call `poll` from one thread only. report: called with each fault. clock_s: monotonic clock, s. wait: waits for a
    number of seconds or until `wake`. Tests pass other clock_s and wait.
    """

    def __init__(
        self,
        driver: Driver,
        device: Device,
        report: Callable[[CameraFault], None],
        rule: RecoveryRule | None = None,
        clock_s: Callable[[], float] = time.monotonic,
        wait: Callable[[float], object] | None = None,
    ) -> None:
        self.state = CameraState.RUNNING
        self._driver, self._report, self._clock_s, self._rule = driver, report, clock_s, rule or RecoveryRule()
        self._wake = threading.Event()
        self._wait = wait or self._wake.wait
        self._device: Device | None = device
        self._check = DeliveryCheck(driver.name, size_of(device.size, driver.name), report)
        self.clock = self._check.clock
        self._intervals_s: deque[float] = deque(maxlen=30)
        self._heard_s = clock_s()  # the latest frame or opening
        self._fresh = True  # no frame since the device was opened
        self._spent = 0.0  # restarts that frames have not restored
        self._failures = 0
        self._late_s: float | None = None
        self._due_s = 0.0
        self._away_s = 0.0
        self._removed = False
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

    def stream_s(self) -> float | None:
        """The current time on the stream clock, s."""
        return self.clock.now_s(self._clock_s())

    def poll(self) -> Picture | None:
        """The next good picture, with its stamp on the stream clock; None if there is none yet.

        Blocks no longer than one grab, one opening or `TICK_S`. Raises CameraLostError once the budget is spent.
        """
        if self._removed and self._device is not None:
            self._removed = False
            self._fault(FaultKind.REMOVED, "was removed")
            self._give_up_device()
        if self._device is None:
            return self._reopen()
        begun_s = self._clock_s()
        try:
            picture = self._device.grab()
            now_s = self._clock_s()
            good = None if picture is None else self._check(picture, now_s)
        except BaseException as error:  # drivers raise what they like: cv2.error, OSError, SystemExit of a plugin
            self._failed(error, self._clock_s() - begun_s)
            return None
        if good is None:
            self._silent(now_s)
            return None
        self._heard(now_s)
        return good

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

    def _failed(self, error: BaseException, took_s: float) -> None:
        self._failures += 1
        if self._failures == 1:
            self._fault(FaultKind.FAILED, f"stopped delivering ({error_line(error)})")
        # A grab that ran into a time limit (of a network stream) has already taken the time of the retries.
        if self._failures > RETRIES or took_s >= self._stall_limit_s:
            self._give_up_device()
        else:
            self._wait(0.05)

    def _silent(self, now_s: float) -> None:
        limit_s = self._stall_limit_s
        silent_s = now_s - self._heard_s
        if silent_s < limit_s:
            return
        if self._late_s is None:
            self._late_s = now_s
            self._fault(FaultKind.LATE, f"no frame for {silent_s:.1f} s (limit {limit_s:.1f} s)")
            if not self._fresh:  # one more limit: this process itself may have stalled
                return
        if self._fresh or now_s - self._late_s >= limit_s:
            self._give_up_device()

    def _heard(self, now_s: float) -> None:
        if self.state is CameraState.DEGRADED:
            self.state = CameraState.RUNNING
            text = f"delivers again after {now_s - self._away_s:.1f} s"
            self._report(CameraFault(FaultKind.RECOVERED, f"camera {self._driver.name}: {text}"))
        if not self._fresh:
            self._intervals_s.append(now_s - self._heard_s)
            self._spent = max(0.0, self._spent - (now_s - self._heard_s) / BACK_OFF_LIMIT_S)
        self._heard_s, self._fresh = now_s, False
        self._failures, self._late_s = 0, None

    def _give_up_device(self) -> None:
        self.close()
        self._failures, self._late_s = 0, None
        self._back_off()

    def _back_off(self) -> None:
        """Sets when the next restart is due: the first of a sequence at once."""
        restarts = round(self._spent)
        self._due_s = self._clock_s() + min(BACK_OFF_LIMIT_S, TICK_S * 2.0 ** (restarts - 1) if restarts else 0.0)

    def _reopen(self) -> None:
        now_s = self._clock_s()
        if now_s < self._due_s:
            self._wake.clear()
            self._wait(min(TICK_S, self._due_s - now_s))
            return
        if self._spent > self._rule.restarts - 1:
            self.state = CameraState.LOST
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
        except BaseException as error:  # as in `poll`
            self._fault(FaultKind.CLOSED, f"does not open ({error_line(error)})")
            self._back_off()
            return
        self._removed = False
        self.clock.restart()
        self._heard_s = self._clock_s()

    def _fault(self, kind: FaultKind, text: str) -> None:
        if self.state is CameraState.RUNNING:
            self.state, self._away_s = CameraState.DEGRADED, self._heard_s
        self._report(CameraFault(kind, f"camera {self._driver.name}: {text}"))
