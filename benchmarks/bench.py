"""Speed of the whole step on this processor: frames per second, latency by stage, memory; and against others."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import psutil
from numpy.typing import NDArray

from edgemap.runtime.cameras.protocol import Camera
from edgemap.runtime.cameras.reading import next_frame
from edgemap.runtime.errors import CameraError
from edgemap.runtime.frame import Frame
from edgemap.runtime.slam import SemanticSlam
from edgemap.runtime.timing import percentiles

RING = 64  # decoded frames kept, cycled forwards and backwards
WARM_UP = 10  # steps before the clock starts
REST_S = 0.02  # between rivals, so that no one's spinning threads slow the next


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


def measure(slam: SemanticSlam, ring: Ring, seconds: float) -> dict[str, Any]:
    """Run the step over the ring for so many seconds; the numbers of `edgemap bench`."""
    frames = ring.cycle()
    for _ in range(WARM_UP):
        slam.step(next(frames))
    totals: list[float] = []
    stages: dict[str, list[float]] = {}
    process = psutil.Process()
    process.cpu_percent()
    start = time.perf_counter()
    while time.perf_counter() - start < seconds:
        before = time.perf_counter()
        result = slam.step(next(frames))
        totals.append((time.perf_counter() - before) * 1e3)
        for stage, lap_ms in result.stages_ms.items():
            stages.setdefault(stage, []).append(lap_ms)
    wall = time.perf_counter() - start
    return {
        "fps": round(len(totals) / wall, 2),
        "frames": len(totals),
        "latency_ms": percentiles(totals),
        "stages_ms": {stage: percentiles(laps) for stage, laps in stages.items()},
        "decode_ms": round(ring.decode_ms, 3),
        "cpu_percent": round(process.cpu_percent(), 1),
        "peak_rss_mb": round(peak_rss_mb(), 1),
    }


def peak_rss_mb() -> float:
    """The most memory that this process has held, MB."""
    try:
        import resource
    except ImportError:  # Windows
        return psutil.Process().memory_info().rss / 1e6
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3


def compare(
    ours: Callable[[NDArray[np.uint8]], object],
    full: Callable[[Frame], object],
    theirs: Callable[[NDArray[np.uint8]], object],
    networks: tuple[Callable[[], object], Callable[[], object]],
    ring: Ring,
    seconds: float,
) -> dict[str, float]:
    """Ours and theirs in turn over the same frames in one run: ratios of median latency, ours / theirs, and ms.

    ours, theirs: a picture to boxes. full: our whole step. networks: only the network, ours and theirs.
    """
    names = ("ours_end_to_end", "theirs_end_to_end", "ours_full", "ours_network", "theirs_network")
    laps: dict[str, list[float]] = {name: [] for name in names}
    frames = ring.cycle()
    start, rounds = time.perf_counter(), 0
    while time.perf_counter() - start < seconds or rounds < 5:
        frame = next(frames)
        calls = (
            lambda frame=frame: ours(frame.image),
            lambda frame=frame: theirs(frame.image),
            lambda frame=frame: full(frame),
            networks[0],
            networks[1],
        )
        order = range(len(calls)) if rounds % 2 else reversed(range(len(calls)))
        for turn in order:
            time.sleep(REST_S)
            before = time.perf_counter()
            calls[turn]()
            if rounds >= 2:
                laps[names[turn]].append((time.perf_counter() - before) * 1e3)
        rounds += 1
    median = {name: float(np.median(values)) for name, values in laps.items()}
    return {
        "network_ratio": round(median["ours_network"] / median["theirs_network"], 3),
        "end_to_end_ratio": round(median["ours_end_to_end"] / median["theirs_end_to_end"], 3),
        "full_ratio": round(median["ours_full"] / median["theirs_end_to_end"], 3),
        **{f"{name}_ms": round(value, 3) for name, value in median.items()},
    }
