"""Small recordings for tests: pictures of noise, a lens and a mount with no number that is nought."""

from pathlib import Path

import numpy as np

from edgemap.bridges.ros2.recordings.facts import Facts
from edgemap.bridges.ros2.recordings.recorder import Recorder
from edgemap.geometry.camera.intrinsics import Distortion, Intrinsics
from edgemap.geometry.camera.mount import Mount
from edgemap.runtime.frames.camera import Camera
from edgemap.runtime.frames.frame import Frame

LENS = Intrinsics(
    64, 48, 58.25, 58.5, 31.4, 23.6, Distortion("inverse_brown_conrady", (-0.05, 0.06, 0.0009, -0.0006, -0.02))
)
MOUNT = Mount.from_degrees(0.6, 11.5, 1.25, 0.15, -0.02)
FACTS = Facts("test", LENS, MOUNT, 10.0)


def noise(count: int) -> list[Frame]:
    """Pictures of 64x48 px at 30 Hz on a Unix clock, always the same ones."""
    random = np.random.default_rng(7)
    pictures = random.integers(0, 256, (count, 48, 64, 3), dtype=np.uint8)
    return [Frame(i, 1.7e9 + i / 30, picture, f"noise#{i}") for i, picture in enumerate(pictures)]


def record(path: Path, facts: Facts, frames: list[Frame], **options) -> Path:
    recorder = Recorder(path, facts, **options)
    try:
        for frame in frames:
            recorder.picture(frame)
    finally:
        recorder.close()
    return path


def drain(camera: Camera) -> list[Frame]:
    frames = []
    while (frame := camera.read()) is not None:
        frames.append(frame)
    return frames
