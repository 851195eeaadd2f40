"""Cost of a standing robot: one picture of a source, repeated with a sensor's noise."""

import time
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from edgemap.benchmarks.bench import OpenDrive, measure
from edgemap.runtime.frames.errors import CameraError
from edgemap.runtime.frames.frame import Frame
from edgemap.runtime.frames.trajectory import PoseTrack
from edgemap.runtime.inputs.cameras.base import CameraAround
from edgemap.runtime.inputs.cameras.protocol import Camera, next_frame
from edgemap.runtime.inputs.drives.pictures import decode_picture

NOISE = 2.0  # grey levels a pixel, standard deviation
PICTURES = 16  # that differ, in turn
FALL_ASLEEP_S = 3.0  # before the clock starts


class StandingCamera(CameraAround):
    """The first picture of a camera for ever, each time with other noise and as a JPEG that is decoded, as a USB
    camera delivers it; no wheels and no IMU. Raises CameraError where there is no first picture.
    """

    def __init__(self, camera: Camera, rate_hz: float) -> None:
        super().__init__(camera)
        self.wheel: Path | PoseTrack | None = None
        first = next_frame(camera, lambda _: None)
        if first is None:
            raise CameraError(f"{camera.name}: no frames")
        random = np.random.default_rng(0)
        noisy = (first.image + random.normal(0.0, NOISE, first.image.shape) for _ in range(PICTURES))
        self._jpegs = [cv2.imencode(".jpg", np.clip(one, 0, 255).astype(np.uint8))[1].tobytes() for one in noisy]
        self._rate_hz, self._start_s, self._spent_s = rate_hz, first.stamp_s, 0.0

    @property
    def decode_ms(self) -> float:
        """Processor time of one decoding, mean so far."""
        return 1e3 * self._spent_s / max(1, self._delivered)

    def read(self) -> Frame:
        """The next one; there is always one."""
        before = time.process_time()
        image = decode_picture(self._jpegs[self._delivered % PICTURES], self.name)
        self._spent_s += time.process_time() - before
        return self.frame(image, self._start_s + self._delivered / self._rate_hz, self.name)


def measure_at_rest(open_standing: OpenDrive, seconds: float, rate_hz: float) -> dict[str, Any]:
    """Processor time at rest: `cpu_percent` (of one core) and `cpu_ms_per_frame` of the step, with the decoding of the
    picture in `cpu_percent_with_decoding`; frames at rest while the clock ran. open_standing: a drive of a
    `StandingCamera`."""
    found = measure(open_standing, seconds, rate_hz, warm_up=round(FALL_ASLEEP_S * rate_hz))
    kept = {key: found[key] for key in ("frames", "at_rest", "cpu_ms_per_frame", "cpu_percent", "stages_cpu_ms")}
    camera = open_standing()[0]
    with camera:
        assert isinstance(camera, StandingCamera)
        for _ in range(PICTURES):
            camera.read()
        whole = found["cpu_percent"] + 0.1 * camera.decode_ms * rate_hz
        return kept | {"decode_ms": round(camera.decode_ms, 3), "cpu_percent_with_decoding": round(whole, 1)}
