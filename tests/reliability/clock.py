"""Hostile clocks: stamps that jump, stand, go back or are none; the stream's own only goes on."""

import math
from pathlib import Path
from random import Random
from typing import Any

import numpy as np

from edgemap.runtime.frames.camera import Camera, Picture
from edgemap.runtime.frames.errors import CameraFault, CameraState, FrameTimeout
from edgemap.runtime.frames.frame import Frame
from edgemap.runtime.inputs.cameras.checked import CheckedCamera
from edgemap.runtime.inputs.cameras.delivery import DeliveryCheck, clock_jumps
from reliability.parts import PartReport
from reliability.workers import INPUTS, ReaderCase, examine

FRAMES = 20
ODD = (None, math.nan, math.inf, -math.inf, "now", [], 10**400, True, 0.0, -1.0, 1e18, 2**63)


def run(seed: int, share: float, out: Path) -> PartReport:
    """20,000 clocks for devices and for cameras. out: failing inputs are kept here."""
    return examine(cases, seed, max(1, round(INPUTS * share)), out)


def cases(scratch: Path) -> list[ReaderCase]:
    """A live device's stamps, and those of another package's camera."""
    return [ReaderCase("devices", _stamps, _use_device), ReaderCase("cameras", _stamps, _use_camera)]


def _stamps(random: Random) -> list[tuple[Any, float]]:
    """(the device's stamp, the host's seconds at arrival): steps of the system clock, NTP, restarts, nonsense."""
    device_s, host_s, rows = random.choice((0.0, 1.7e9, -5.0, 1e6)), random.uniform(0.0, 1e5), []
    for _ in range(FRAMES):
        step_s = random.choice((0.1, 0.1, 0.1, 0.033, 0.0, 3.0))
        device_s += step_s
        host_s += max(step_s, 1e-3)
        if random.random() < 0.15:
            device_s += random.choice((-3600.0, 3600.0, -0.02, 0.5, -1e9, 1e9, -device_s))
        rows.append((random.choice(ODD) if random.random() < 0.1 else device_s, host_s))
    return rows


def _image(number: int) -> np.ndarray:
    image = np.full((16, 16, 3), number % 251, np.uint8)
    image[..., 0] = (number + 100) % 251
    return image


def _use_device(folder: Path, data: list[tuple[Any, float]]) -> None:
    faults: list[CameraFault] = []
    check = DeliveryCheck("device", (16, 16), faults.append)
    stamps, hosts = [], []
    for number, (stamp_s, host_s) in enumerate(data):
        picture = check(Picture(stamp_s, _image(number)), host_s)  # pyright: ignore[reportArgumentType]
        if picture is not None:
            stamps.append(picture.stamp_s)
            hosts.append(host_s)
    _goes_on(stamps)
    assert len(stamps) == FRAMES, f"{len(stamps)} of {FRAMES} pictures"
    steps = zip(np.diff(stamps), np.diff(hosts), strict=True)
    assert not any(clock_jumps(step_s - 1e-6, passed_s) for step_s, passed_s in steps), "the stream's clock jumps"


class _Theirs(Camera):
    def __init__(self, stamps: list[Any]) -> None:
        super().__init__("theirs")
        self.size, self._stamps = (16, 16), list(enumerate(stamps))

    @property
    def state(self) -> CameraState:
        """As any file's."""
        return CameraState.RUNNING

    def read(self) -> Frame | None:
        """The next frame, at whatever stamp."""
        if not self._stamps:
            return None
        number, stamp_s = self._stamps.pop(0)
        return Frame(number, stamp_s, _image(number))


def _use_camera(folder: Path, data: list[tuple[Any, float]]) -> None:
    camera = CheckedCamera(_Theirs([stamp_s for stamp_s, _ in data]), "theirs")
    stamps, faults = [], 0
    while True:
        try:
            frame = camera.read()
        except CameraFault:
            faults += 1
            assert faults <= FRAMES, "more faults than frames"
            continue
        except FrameTimeout:
            continue
        if frame is None:
            break
        stamps.append(frame.stamp_s)
    _goes_on(stamps)
    assert len(stamps) == FRAMES, f"{len(stamps)} of {FRAMES} frames"


def _goes_on(stamps: list[float]) -> None:
    assert np.isfinite(stamps).all()
    assert (np.diff(stamps) > 0.0).all(), "a stamp that does not go on"
