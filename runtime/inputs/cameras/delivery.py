"""Checks the frames of a live device: stamp, size, format, repeats. Picture content is checked elsewhere."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from edgemap.runtime.frames.errors import CameraError, CameraFault, FaultKind
from edgemap.runtime.inputs.cameras.protocol import Picture
from edgemap.runtime.inputs.cameras.returned import depth_of, image_of, picture_fault, picture_of, stamp_of

SAMPLE_STEP = 8  # px between the pixels that are compared
DARKEST, BRIGHTEST = 8.0, 247.0  # mean levels beyond which a colour picture may well have no colour
CLOCK_JUMP_LIMIT_S = 1.0  # stamps may run ahead of the host's clock by this much: frames that lay in a queue
SMALLEST_STEP_S = 1e-4
BACKWARD_LIMIT_S = 0.05  # a clock that is being disciplined steps back a little; less than a frame is not a fault


class DeliveryCheck:
    """Turns a device's pictures into those of one stream. size: (width, height) in px that every one must have.

    report: called with each fault. A fault that lasts several frames is reported once, when it begins.
    """

    def __init__(self, name: str, size: tuple[int, int], report: Callable[[CameraFault], None]) -> None:
        self.clock = StreamClock()
        self._name, self._size, self._report = name, size, report
        self._stamp_s: float | None = None
        self._sample: NDArray[np.uint8] | None = None
        self._coloured = False
        self._wrong: set[FaultKind] = set()

    def __call__(self, grabbed: Any, arrived_s: float) -> Picture | None:
        """The picture at its stamp in the stream; None where it is not a new picture of this camera. grabbed: what a
        driver returned."""
        now: set[FaultKind] = set()
        picture, stamp_s, depth, bgr = None, math.nan, None, None
        try:
            given = picture_of(grabbed)
            stamp_s, bgr = stamp_of(given.stamp_s), self._shaped(image_of(given.image), now)
            depth = None if bgr is None else self._depth(given.depth, bgr, now)
        except CameraError as error:
            self._note(now, FaultKind.FORMAT, str(error))
        if bgr is not None:
            same = self._same(bgr, now)
            if same and stamp_s == self._stamp_s:
                bgr = None
            else:
                stream_s, wrong = self.clock.stamp(stamp_s, arrived_s)
                if wrong is not None:
                    self._note(now, wrong, f"stamp {stamp_s:.6g} s after {self._stamp_s or 0.0:.6g} s, host's taken")
                picture, self._stamp_s = Picture(stream_s, bgr, depth), stamp_s
        self._wrong = now
        return None if bgr is None else picture

    def _depth(self, depth: Any, image: NDArray[np.uint8], now: set[FaultKind]) -> NDArray[np.float32] | None:
        """Left out, with a fault, where it is none of this picture's."""
        try:
            return depth_of(depth, (image.shape[0], image.shape[1]))
        except CameraError as error:
            self._note(now, FaultKind.FORMAT, f"{error}; left out")
            return None

    def _shaped(self, image: NDArray[Any], now: set[FaultKind]) -> NDArray[np.uint8] | None:
        if image.dtype == np.uint8 and (image.ndim == 2 or (image.ndim == 3 and image.shape[2] == 1)):
            self._note(now, FaultKind.GREY, "picture has one channel")
            image = np.repeat(image.reshape(*image.shape[:2], 1), 3, axis=2)
        if (fault := picture_fault(image, self._size)) is not None:
            self._note(now, *fault)
            return None
        return image

    def _same(self, image: NDArray[np.uint8], now: set[FaultKind]) -> bool:
        sample = image[::SAMPLE_STEP, ::SAMPLE_STEP].copy()
        same = self._sample is not None and np.array_equal(sample, self._sample)
        self._sample = sample
        if same:
            self._note(now, FaultKind.STALE, "the same picture again")
        grey = bool((sample[..., :1] == sample).all())
        if grey and self._coloured and DARKEST < sample.mean() < BRIGHTEST:
            self._note(now, FaultKind.GREY, "pictures have lost their colour")
        self._coloured |= not grey
        return same

    def _note(self, now: set[FaultKind], kind: FaultKind, text: str) -> None:
        now.add(kind)
        if kind not in self._wrong:
            self._report(CameraFault(kind, f"camera {self._name}: {text}"))


def clock_jumps(step_s: float, passed_s: float) -> bool:
    """Whether a device clock has jumped that advanced by `step_s` while the host's advanced by `passed_s`."""
    return step_s < -BACKWARD_LIMIT_S or step_s > passed_s + CLOCK_JUMP_LIMIT_S


class StreamClock:
    """Adds an offset to device stamps. Where they stop, jump or are not finite, time advances by the host's clock. A
    jump changes the offset permanently.
    """

    def __init__(self) -> None:
        self.last_s: float | None = None
        self.arrived_s = 0.0
        self._device_s, self._device_host_s = math.nan, 0.0  # the newest good stamp, and when it arrived
        self._offset_s = 0.0
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
                self._offset_s = by_host_s - device_s
            stamp_s = max(device_s + self._offset_s, self.last_s + SMALLEST_STEP_S) if good else by_host_s
        if good:
            self._device_s, self._device_host_s = device_s, host_s
        self.last_s, self.arrived_s = stamp_s, host_s
        return stamp_s, wrong
