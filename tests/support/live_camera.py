"""Cameras that a test drives on a clock of its own: what a device does is a script, what time it is a number."""

from typing import Any

import numpy as np

from edgemap.runtime.frames.camera import CameraOptions, next_frame
from edgemap.runtime.inputs.cameras.live import LiveCamera


class Clock:
    """Seconds that pass when somebody waits."""

    def __init__(self, now_s=1000.0):
        self.now_s, self.waits = now_s, []

    def __call__(self):
        return self.now_s

    def wait(self, seconds):
        self.waits.append(seconds)
        self.now_s += max(seconds, 1e-3)


def picture(level, size=(6, 4)):
    """No repeat of another level's."""
    return np.full((size[1], size[0], 3), level % 256, np.uint8)


class ScriptedDriver:
    """A camera at `rate_hz`. script: what the n-th grabs give: a value to raise, anything to return, or None for
    silence; a frame with the device's own clock else. closed: how often `open` fails after the first time."""

    name = "fake"

    def __init__(self, clock, script=None, rate_hz=10.0, closed=0, size=(6, 4)):
        self.clock, self.script, self.closed = clock, dict(script or {}), closed
        self.period_s, self.size, self.rate_hz, self.intrinsics = 1.0 / rate_hz, size, rate_hz, None
        self.calls, self.opened, self.grabs, self.changed = [], 0, 0, None

    def open(self):
        self.calls.append("open")
        if self.opened and self.closed:
            self.closed -= 1
            raise RuntimeError("failed to set power state")
        self.opened += 1
        return self

    def grab(self):
        self.clock.wait(self.period_s)
        number, self.grabs = self.grabs, self.grabs + 1
        planned = self.script.pop(number, "frame")
        if planned is None:
            return None
        if isinstance(planned, BaseException):
            raise planned
        if not isinstance(planned, str) or planned != "frame":
            return planned  # whatever it is
        return self.clock() - 900.0, picture(number, self.size)

    def close(self):
        self.calls.append("close")

    def reset(self):
        self.calls.append("reset")

    def watch(self, changed):
        self.changed = changed


def scripted(script=None, rule=None, **options) -> Any:
    """(camera, driver, clock)."""
    clock = Clock()
    driver: Any = ScriptedDriver(clock, script, **options)
    return LiveCamera(driver, CameraOptions(recovery=rule), clock_s=clock, wait=clock.wait), driver, clock


def drain(camera, frames, told=None):
    """The next frames; faults go to `told`, and timeouts are waited through."""
    told = [] if told is None else told
    return [next_frame(camera, told.append) for _ in range(frames)]
