"""Checks the frames of a live device: stamp, size, format. Picture content is checked elsewhere."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from edgemap.runtime.frames.camera import Picture
from edgemap.runtime.frames.errors import CameraFault
from edgemap.runtime.frames.faults import FaultKind
from edgemap.runtime.frames.reading import one_line
from edgemap.runtime.inputs.cameras.checked import PictureCheck, stamp_of

CLOCK_JUMP_LIMIT_S = 1.0  # stamps may run ahead of the host's clock by this much: frames that lay in a queue
SMALLEST_STEP_S = 1e-4
BACKWARD_LIMIT_S = 0.05  # a clock that is being disciplined steps back a little; less than a frame is not a fault


class DeliveryCheck(PictureCheck):
    """Turns a device's pictures into those of one stream."""

    def __init__(self, name: str, size: tuple[int, int], report: Callable[[CameraFault], None]) -> None:
        super().__init__(name, size, report)
        self.clock = StreamClock()
        self._stamp_s: float | None = None
        self._image = np.zeros(0, np.uint8)

    def __call__(self, grabbed: Any, arrived_s: float) -> Picture | None:
        """The picture at its stamp in the stream; None where it is not a new picture of this camera. grabbed: what a
        driver returned."""
        self.begin()
        try:
            picture = Picture(*grabbed)
        except TypeError:
            text = f"a grab gave a {type(grabbed).__name__}, not (stamp_s, image) or a Picture"
            self.note(FaultKind.FORMAT, text)
            return None
        why, depth = (one_line(picture.depth), None) if isinstance(picture.depth, str) else ("", picture.depth)
        stamp_s, checked = stamp_of(picture.stamp_s), self.picture(picture.image, depth)
        if checked is None or (stamp_s == self._stamp_s and np.array_equal(checked[0], self._image)):
            return None
        stream_s, wrong = self.clock.stamp(stamp_s, arrived_s)
        if wrong is not None:
            self.note(wrong, f"stamp {stamp_s:.6g} s after {self._stamp_s or 0.0:.6g} s, host's taken")
        self._stamp_s, self._image = stamp_s, checked[0]
        return Picture(stream_s, checked[0], why or checked[1])


def clock_jumps(step_s: float, passed_s: float) -> bool:
    """Whether a device clock has jumped that advanced by `step_s` while the host's advanced by `passed_s`."""
    return step_s < -BACKWARD_LIMIT_S or step_s > passed_s + CLOCK_JUMP_LIMIT_S


class StreamClock:
    """Adds an offset (`offset_s`) to device stamps. Where they stop, jump or are not finite, time advances by the
    host's clock. A jump changes the offset permanently.
    """

    def __init__(self) -> None:
        self.last_s: float | None = None
        self.arrived_s = 0.0
        self._device_s, self._device_host_s = math.nan, 0.0  # the newest good stamp, and when it arrived
        self.offset_s = 0.0
        self._restarted = False

    def restart(self) -> None:
        """The device was opened again: its clock may have begun again, which is not a fault."""
        self._restarted = True

    def now_s(self, host_s: float) -> float | None:
        """The time now on the stream's clock; None before its first stamp."""
        return None if self.last_s is None else self.last_s + max(0.0, host_s - self.arrived_s)

    def stamp(self, device_s: float, host_s: float) -> tuple[float, FaultKind | None]:
        """The stream's stamp of a frame that arrived at `host_s`, and the fault of the device's stamp, if any."""
        restarted, self._restarted = self._restarted, False
        good = math.isfinite(device_s) and (device_s != self._device_s or restarted)
        wrong = None if good else FaultKind.STAMP
        if self.last_s is None:
            stamp_s = device_s if good else host_s
        else:
            by_host_s = self.last_s + max(SMALLEST_STEP_S, host_s - self.arrived_s)
            if good and not restarted and clock_jumps(device_s - self._device_s, host_s - self._device_host_s):
                wrong = FaultKind.CLOCK
            if good and (wrong or restarted or math.isnan(self._device_s)):
                self.offset_s = by_host_s - device_s
            stamp_s = max(device_s + self.offset_s, self.last_s + SMALLEST_STEP_S) if good else by_host_s
        if good:
            self._device_s, self._device_host_s = device_s, host_s
        self.last_s, self.arrived_s = stamp_s, host_s
        return stamp_s, wrong
