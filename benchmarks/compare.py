"""Ours against a rival's loop, in turn over the same frames in one run."""

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from edgemap.benchmarks.bench import OpenDrive, drive_chunks

REST_S = 0.02  # after each call, so that nobody's waiting threads slow the next; what they burn in it counts as theirs
WARM_UP, MINIMUM_ROUNDS = 2, 5

Boxes = Callable[[NDArray[np.uint8]], object]


@dataclass(frozen=True, slots=True)
class Contest:
    """The interleaved candidates. ours, theirs: a picture to boxes. networks: the network alone, ours and theirs."""

    ours: Boxes
    theirs: Boxes
    networks: tuple[Callable[[], object], Callable[[], object]]


def compare(contest: Contest, open_drive: OpenDrive, seconds: float) -> dict[str, float]:
    """Ratios of medians, ours / theirs, and the medians: latency, ms, and processor time, cpu_ms.

    full_ratio: our whole step, with odometry and map, against their picture to boxes.
    """
    names = ("ours_end_to_end", "theirs_end_to_end", "ours_full", "ours_network", "theirs_network")
    wall: dict[str, list[float]] = {name: [] for name in names}
    cpu: dict[str, list[float]] = {name: [] for name in names}
    start = time.perf_counter()
    steps = ((slam, frame) for slam, frames in drive_chunks(open_drive) for frame in frames)
    for rounds, (slam, frame) in enumerate(steps):
        calls = (
            lambda frame=frame: contest.ours(frame.image),
            lambda frame=frame: contest.theirs(frame.image),
            lambda slam=slam, frame=frame: slam.step(frame),
            *contest.networks,
        )
        order = range(len(calls)) if rounds % 2 else reversed(range(len(calls)))
        for turn in order:
            spent, before = time.process_time(), time.perf_counter()
            calls[turn]()
            took = time.perf_counter() - before
            time.sleep(REST_S)
            if rounds >= WARM_UP:
                wall[names[turn]].append(1e3 * took)
                cpu[names[turn]].append(1e3 * (time.process_time() - spent))
        if time.perf_counter() - start >= seconds and rounds + 1 >= MINIMUM_ROUNDS:
            break
    ms = {name: float(np.median(values)) for name, values in wall.items()}
    cpu_ms = {name: float(np.median(values)) for name, values in cpu.items()}
    return {
        "network_ratio": round(ms["ours_network"] / ms["theirs_network"], 3),
        "end_to_end_ratio": round(ms["ours_end_to_end"] / ms["theirs_end_to_end"], 3),
        "full_ratio": round(ms["ours_full"] / ms["theirs_end_to_end"], 3),
        "cpu_ratio": round(cpu_ms["ours_end_to_end"] / max(cpu_ms["theirs_end_to_end"], 1e-9), 3),
        **{f"{name}_ms": round(value, 3) for name, value in ms.items()},
        **{f"{name}_cpu_ms": round(value, 3) for name, value in cpu_ms.items()},
    }
