"""Small recordings for tests: pictures of noise, a lens and a mount with no number that is nought."""

from dataclasses import replace
from pathlib import Path

import numpy as np
from mcap.writer import Writer

from edgemap.bridges.ros2.messages.definitions import definition, encoder
from edgemap.bridges.ros2.recordings.recorder import Recorder
from edgemap.geometry.camera.intrinsics import Distortion, Intrinsics
from edgemap.geometry.camera.mount import Mount
from edgemap.runtime.frames.camera import Camera, CameraInfo
from edgemap.runtime.frames.frame import Frame

BENT = Distortion("inverse_brown_conrady", (-0.05, 0.06, 0.0009, -0.0006, -0.02))
LENS = Intrinsics(64, 48, 58.25, 58.5, 31.4, 23.6, BENT)
MOUNT = Mount.from_degrees(0.6, 11.5, 1.25, 0.15, -0.02)
FACTS = CameraInfo("test", intrinsics=LENS, mount=MOUNT, rate_hz=10.0)


def noise(count: int) -> list[Frame]:
    """Pictures of 64x48 px at 30 Hz on a Unix clock, always the same ones."""
    random = np.random.default_rng(7)
    pictures = random.integers(0, 256, (count, 48, 64, 3), dtype=np.uint8)
    return [Frame(i, 1.7e9 + i / 30, picture, f"noise#{i}") for i, picture in enumerate(pictures)]


def record(path: Path, info: CameraInfo, frames: list[Frame], lossless: bool = False, **tracks) -> Path:
    recorder = Recorder(path, replace(info, **tracks), lossless=lossless)
    try:
        for frame in frames:
            recorder.picture(frame)
    finally:
        recorder.close()
    return path


def bag(path: Path, messages, encodings=("ros2msg", "cdr"), **options) -> Path:
    """An MCAP file of (topic, kind, stamp_ns, fields or bytes), written by mcap's own writer."""
    with path.open("wb") as file:
        writer, channels = Writer(file, **options), {}
        writer.start("ros2", "test")
        for topic, kind, stamp_ns, fields in messages:
            if (topic, kind) not in channels:
                schema = writer.register_schema(kind, encodings[0], definition(kind).encode())
                channels[topic, kind] = writer.register_channel(topic, encodings[1], schema)
            data = fields if isinstance(fields, bytes) else encoder(kind)(fields)
            writer.add_message(channels[topic, kind], stamp_ns, bytes(data), stamp_ns)
        writer.finish()
    return path


def drain(camera: Camera) -> list[Frame]:
    return list(iter(camera.read, None))
