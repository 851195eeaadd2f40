"""A device's stamps to the stamps of one stream, which only go forward whatever the device's clock does."""

from __future__ import annotations

import math

from edgemap.runtime.cameras.fault import FaultKind

CLOCK_JUMP_LIMIT_S = 1.0  # stamps may run ahead of the host's clock by this much: frames that lay in a queue
SMALLEST_STEP_S = 1e-4
BACKWARD_LIMIT_S = 0.05  # a clock that is being disciplined steps back a little; less than a frame is no fault


class StreamClock:
    """Adds an offset to device stamps; where they jump, stand, or are no numbers, time goes on by the host's clock."""

    def __init__(self) -> None:
        self.last_s: float | None = None
        self.arrived_s = 0.0
        self._device_s = math.nan
        self._offset_s = 0.0
        self._restarted = False

    def restart(self) -> None:
        """The device was opened again: its clock may have begun anew, which is no fault."""
        self._restarted = True

    def now_s(self, host_s: float) -> float | None:
        """The time now on the stream's clock; None before its first stamp."""
        return None if self.last_s is None else self.last_s + max(0.0, host_s - self.arrived_s)

    def stamp(self, device_s: float, host_s: float) -> tuple[float, FaultKind | None]:
        """The stream's stamp of a frame that arrived at `host_s`, and what was wrong with the device's."""
        if self.last_s is None:
            self._offset_s, wrong = 0.0, None if math.isfinite(device_s) else FaultKind.STAMP
            stamp_s = device_s if math.isfinite(device_s) else host_s
        else:
            wrong = self._wrong(device_s, host_s)
            stamp_s = device_s + self._offset_s
            if wrong is not None or self._restarted or not math.isfinite(stamp_s - self.last_s):
                stamp_s = self.last_s + max(SMALLEST_STEP_S, host_s - self.arrived_s)
                self._offset_s = stamp_s - device_s
            stamp_s = max(stamp_s, self.last_s + SMALLEST_STEP_S)
        if self._restarted:
            wrong, self._restarted = (wrong if wrong is FaultKind.STAMP else None), False
        self.last_s, self.arrived_s = stamp_s, host_s
        self._device_s = device_s if math.isfinite(device_s) else math.nan
        return stamp_s, wrong

    def _wrong(self, device_s: float, host_s: float) -> FaultKind | None:
        if not math.isfinite(device_s) or device_s == self._device_s:
            return FaultKind.STAMP
        step_s = device_s - self._device_s
        if step_s < -BACKWARD_LIMIT_S or step_s > host_s - self.arrived_s + CLOCK_JUMP_LIMIT_S:
            return FaultKind.CLOCK
        return None
