"""A device's stamps to the stamps of one stream, which only go forward whatever the device's clock does."""

import math

from edgemap.runtime.cameras.fault import FaultKind

CLOCK_JUMP_LIMIT_S = 1.0  # stamps may run ahead of the host's clock by this much: frames that lay in a queue
SMALLEST_STEP_S = 1e-4
BACKWARD_LIMIT_S = 0.05  # a clock that is being disciplined steps back a little; less than a frame is no fault


def clock_jumps(step_s: float, passed_s: float) -> bool:
    """Whether a device's clock that went on by `step_s` while `passed_s` passed on the host's has jumped."""
    return step_s < -BACKWARD_LIMIT_S or step_s > passed_s + CLOCK_JUMP_LIMIT_S


class StreamClock:
    """Adds an offset to device stamps; where they stand or are no numbers, and where they jump, time goes on by the
    host's clock. A jump changes the offset for good."""

    def __init__(self) -> None:
        self.last_s: float | None = None
        self.arrived_s = 0.0
        self._device_s, self._device_host_s = math.nan, 0.0  # the newest good stamp, and when it arrived
        self._offset_s = 0.0
        self._restarted = False

    def restart(self) -> None:
        """The device was opened again: its clock may have begun again, which is no fault."""
        self._restarted = True

    def now_s(self, host_s: float) -> float | None:
        """The time now on the stream's clock; None before its first stamp."""
        return None if self.last_s is None else self.last_s + max(0.0, host_s - self.arrived_s)

    def stamp(self, device_s: float, host_s: float) -> tuple[float, FaultKind | None]:
        """The stream's stamp of a frame that arrived at `host_s`, and what was wrong with the device's."""
        restarted, self._restarted = self._restarted, False
        good = math.isfinite(device_s) and (device_s != self._device_s or restarted)
        wrong = None if good else FaultKind.STAMP
        if self.last_s is None:
            stamp_s = device_s if good else host_s
        else:
            by_host_s = self.last_s + max(SMALLEST_STEP_S, host_s - self.arrived_s)
            if good and not restarted and self._jumps(device_s, host_s):
                wrong = FaultKind.CLOCK
            if good and (wrong or restarted or math.isnan(self._device_s)):
                self._offset_s = by_host_s - device_s
            stamp_s = max(device_s + self._offset_s, self.last_s + SMALLEST_STEP_S) if good else by_host_s
        if good:
            self._device_s, self._device_host_s = device_s, host_s
        self.last_s, self.arrived_s = stamp_s, host_s
        return stamp_s, wrong

    def _jumps(self, device_s: float, host_s: float) -> bool:
        """Against the newest good stamp; never where there is none."""
        return clock_jumps(device_s - self._device_s, host_s - self._device_host_s)
