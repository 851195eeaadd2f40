"""Decoded frames that go round, for measurements of what does not depend on where the robot is."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass

from edgemap.runtime.frames.errors import CameraError
from edgemap.runtime.frames.frame import Frame
from edgemap.runtime.inputs.cameras.protocol import Camera, next_frame

RING = 64  # decoded frames kept, cycled forwards and backwards


@dataclass(frozen=True, slots=True)
class Ring:
    """Decoded frames and what decoding one cost."""

    frames: list[Frame]
    decode_ms: float
    rate_hz: float

    def cycle(self) -> Iterator[Frame]:
        """Forwards and backwards without end, renumbered and stamped evenly."""
        index, there_and_back = 0, [*range(len(self.frames)), *range(len(self.frames) - 2, 0, -1)]
        while True:
            frame = self.frames[there_and_back[index % len(there_and_back)]]
            yield Frame(index, index / self.rate_hz, frame.image, frame.name)
            index += 1


def read_ring(camera: Camera, first: Frame) -> Ring:
    """Fill a ring from a camera whose first frame was read already. Raises CameraError for fewer than two frames."""
    frames, start = [first], time.perf_counter()
    while len(frames) < RING and (frame := next_frame(camera, lambda _: None)) is not None:
        frames.append(frame)
    if len(frames) < 2:
        raise CameraError(f"bench needs two frames or more, {camera.name} gave {len(frames)}")
    return Ring(frames, (time.perf_counter() - start) * 1e3 / (len(frames) - 1), camera.rate_hz or 10.0)
