"""A camera on a clock of its own, with the faults that cameras have, behind the real camera classes."""

import math
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from edgemap.runtime.frames.camera import Device, Driver, Picture
from edgemap.runtime.inputs.cameras.webcam import CaptureDevice

# Kinds that end by themselves at `end_s`, or after `count` grabs; kinds that end when the supervisor acts.
PASSING = ("silent", "raise", "stopped", "stale", "standing", "backwards", "nan", "jump", "size", "format", "grey")
ACTING = ("dead", "wedged", "unplugged")
ERRORS = (RuntimeError, OSError, MemoryError, cv2.error, ValueError)


@dataclass(slots=True)
class PlannedFault:
    """One fault. left: grabs, or openings, that it still spoils."""

    kind: str
    start_s: float
    length_s: float
    left: int
    error: type[Exception]
    by_s: float
    begun: bool = False
    since_s: float = math.nan  # when nothing but the supervisor stood between the camera and a frame
    over_s: float = math.nan  # when the cause was gone

    @property
    def over(self) -> bool:
        """Whether the cause is gone."""
        return not math.isnan(self.over_s)

    def end(self, now_s: float, since_s: float | None = None) -> None:
        """The cause is gone."""
        self.over_s, self.since_s = now_s, now_s if since_s is None else since_s


def plan(random: np.random.Generator, count: int, first_s: float, last_s: float) -> list[PlannedFault]:
    """`count` faults of random kinds, one in each of as many equal windows of time."""
    edges = np.linspace(first_s, last_s, count + 1)
    return [
        PlannedFault(
            kind=str(random.choice(PASSING + ACTING)),
            start_s=float(start + random.uniform(0.0, 0.3) * (end - start)),
            length_s=float(random.uniform(0.3, 3.0)),
            left=int(random.integers(1, 4)),
            error=ERRORS[random.integers(len(ERRORS))],
            by_s=float(random.choice([-1.0, 1.0]) * random.uniform(2.0, 1e4)),
        )
        for start, end in pairwise(edges)
    ]


@dataclass
class FaultyWorld:
    """Pictures at their stamps, a clock, and the faults to come. stop: set when the drive is over."""

    images: Sequence[NDArray[np.uint8]]
    stamps_s: Sequence[float]
    faults: list[PlannedFault]
    now_s: float = 0.0
    stop: threading.Event = field(default_factory=threading.Event)
    jumped_s: float = 0.0

    def clock_s(self) -> float:
        """Seconds, which pass when somebody waits."""
        return self.now_s

    def wait(self, seconds: float) -> None:
        """Let time pass."""
        self.now_s += max(seconds, 1e-3)
        if self.now_s > self.stamps_s[-1]:
            self.stop.set()

    def next_index(self) -> int:
        """Wait for the next picture; its number."""
        index = int(np.searchsorted(self.stamps_s, self.now_s + 1e-6))
        if index >= len(self.stamps_s):
            self.wait(0.1)
            return len(self.stamps_s) - 1
        self.wait(self.stamps_s[index] - self.now_s)
        return index

    def active(self, *kinds: str) -> PlannedFault | None:
        """The fault of one of these kinds that is on."""
        for fault in self.faults:
            if fault.kind in kinds and not fault.over and fault.start_s <= self.now_s:
                fault.begun = True
                return fault
        return None


class FaultyDevice:
    """Spoils what another device delivers, as the world's faults say."""

    def __init__(self, world: FaultyWorld, inner: Device) -> None:
        self.size, self.intrinsics, self.rate_hz = inner.size, inner.intrinsics, inner.rate_hz
        self._world, self._inner = world, inner
        self._last: Picture | None = None

    def grab(self) -> Picture | None:
        """The inner device's picture, or what becomes of it."""
        world = self._world
        if fault := world.active("silent"):
            if world.now_s < fault.start_s + fault.length_s:
                world.wait(0.2)
                return None
            fault.end(world.now_s, fault.start_s + fault.length_s)
        if world.active("wedged"):
            world.wait(0.2)
            return None
        if fault := world.active("dead", "unplugged"):
            world.wait(0.02)
            raise fault.error(f"{fault.kind}: xioctl(VIDIOC_DQBUF) failed")
        if fault := world.active("raise"):
            self._spoil(fault)
            raise fault.error("frame didn't arrive\nwithin 5000")
        if fault := world.active("stopped"):
            world.wait(2.0)
            fault.end(world.now_s)
            return None
        grabbed = self._inner.grab()
        if grabbed is None:
            return None
        stamp_s, image = grabbed[0], grabbed[1]
        before, self._last = self._last, Picture(stamp_s, image)
        if (fault := world.active("stale", "standing")) and before is not None:
            self._spoil(fault)
            self._last = last = before if fault.kind == "stale" else Picture(before.stamp_s, image)
            return Picture(last.stamp_s + world.jumped_s, last.image)
        if fault := world.active("jump"):
            self._spoil(fault)
            fault.end(world.now_s)
            world.jumped_s += fault.by_s
        stamp_s += world.jumped_s
        if fault := world.active("backwards", "nan", "size", "format", "grey"):
            self._spoil(fault)
            return _spoilt(fault, stamp_s, image)
        return Picture(stamp_s, image)

    def close(self) -> None:
        """Close the inner device."""
        self._inner.close()

    def _spoil(self, fault: PlannedFault) -> None:
        fault.left -= 1
        if fault.left <= 0:
            fault.end(self._world.now_s)


def _spoilt(fault: PlannedFault, stamp_s: float, image: NDArray[np.uint8]) -> Any:
    odd = fault.by_s > 0
    if fault.kind == "backwards":
        return stamp_s - abs(fault.by_s), image
    if fault.kind == "nan":
        return (math.nan if odd else math.inf), image
    if fault.kind == "size":
        return stamp_s, np.ascontiguousarray(image[::2, ::2])
    if fault.kind == "format":
        return stamp_s, image.astype(np.float32) if odd else np.dstack([image, image[..., :1]])
    grey = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
    return stamp_s, np.asarray(grey if odd else cv2.cvtColor(grey, cv2.COLOR_GRAY2BGR), np.uint8)


class FaultyDriver:
    """A driver whose devices fail, and which fails to open. resets: whether it has a hardware reset."""

    def __init__(self, world: FaultyWorld, inner: Driver, resets: bool) -> None:
        self.name = inner.name
        self._world, self._inner, self._resets = world, inner, resets
        self._changed: Callable[[bool], None] = lambda _: None

    def open(self) -> Device:
        """Open the inner device, unless a fault says no."""
        world = self._world
        world.wait(0.1)
        if fault := world.active("unplugged"):
            if world.now_s < fault.start_s + fault.length_s:
                raise fault.error("No device connected")
            fault.end(world.now_s, fault.start_s + fault.length_s)
            self._changed(True)
        if fault := world.active("dead"):
            if fault.left > 1:
                fault.left -= 1
                raise fault.error("failed to set power state")
            fault.end(world.now_s, fault.start_s)
        if (fault := world.active("wedged")) and not self._resets:
            fault.end(world.now_s, fault.start_s)
        return FaultyDevice(world, self._inner.open())

    def reset(self) -> bool:
        """Cures a wedged device."""
        if self._resets and (fault := self._world.active("wedged")):
            fault.end(self._world.now_s, fault.start_s)
        self._world.wait(0.5)
        return self._resets

    def watch(self, changed: Callable[[bool], None]) -> None:
        """Keep whom to tell of device changes."""
        self._changed = changed


class _Capture:
    """What `CaptureDevice` uses of `cv2.VideoCapture`, over the world's pictures."""

    def __init__(self, world: FaultyWorld) -> None:
        self._world, self._stamp_s = world, 0.0

    def read(self) -> tuple[bool, NDArray[np.uint8]]:
        index = self._world.next_index()
        self._stamp_s = self._world.stamps_s[index]
        return True, self._world.images[index]

    def get(self, what: int) -> float:
        height, width = self._world.images[0].shape[:2]
        return {
            cv2.CAP_PROP_FPS: 10.0,
            cv2.CAP_PROP_FRAME_WIDTH: float(width),
            cv2.CAP_PROP_FRAME_HEIGHT: float(height),
            cv2.CAP_PROP_POS_MSEC: 1000.0 * self._stamp_s,
        }.get(what, 0.0)

    def release(self) -> None:
        """Nothing to let go of."""


class CaptureDriver(Driver):
    """Webcams' own device class over the world."""

    name = "/dev/video0"

    def __init__(self, world: FaultyWorld) -> None:
        self._world = world

    def open(self) -> CaptureDevice:
        """A capture at the world's present."""
        capture: Any = _Capture(self._world)
        return CaptureDevice(capture, self.name, self._world.clock_s)
