"""Cost of the complete step on this processor: latency by stage, processor time, memory.

The step is what `run` drives, over the source's frames in order. Decoding is outside every clock, except for a standing
robot, whose picture is decoded as a USB camera's.
"""

import time
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import replace
from functools import partial
from itertools import cycle, islice
from typing import Any

import cv2
import numpy as np
import psutil

from edgemap.runtime.frames.camera import Camera, FileCamera, Picture, next_frame
from edgemap.runtime.frames.errors import CameraError
from edgemap.runtime.frames.frame import Frame
from edgemap.runtime.frames.timing import Stopwatch, percentiles
from edgemap.runtime.inputs.drives.pictures import decode_picture
from edgemap.runtime.step.slam import SemanticSlam

CHUNK = 30  # frames decoded ahead
WARM_UP = 10  # steps before the clock starts
QUIET_PERCENT = 5.0  # of one core: what other programs and the host may take while the figures count

OpenDrive = Callable[[], tuple[Camera, SemanticSlam]]


def drive_chunks(open_drive: OpenDrive) -> Iterator[tuple[SemanticSlam, list[Frame]]]:
    """The source's frames in order, decoded ahead chunk by chunk; from the start with an empty map at its end.

    Raises CameraError for a source with fewer than two frames.
    """
    while True:
        camera, slam = open_drive()
        count = 0
        with camera:
            frames = iter(partial(next_frame, camera, lambda _: None), None)
            while chunk := list(islice(frames, CHUNK)):
                count += len(chunk)
                yield slam, chunk
        if count < 2:
            raise CameraError(f"bench needs two frames or more, {camera.info.name} gave {count}")


def measure(
    open_drive: OpenDrive, seconds: float, rate_hz: float | None = None, warm_up: int = WARM_UP
) -> dict[str, Any]:
    """Runs the step for some seconds, paced at this camera rate; None for unpaced.

    stages_ms: percentiles by stage; paced instead stages_cpu_ms: mean processor time of the thread that steps.
    cpu_ms_per_frame, cpu_percent (of one core): of this whole process, its waiting threads included.
    at_rest: frames of a robot that stands. searched_hz: pictures a second whose boxes came. other_cpu_percent: of one
    core, what other programs and the host took meanwhile.
    """
    totals, stages = list[float](), defaultdict[str, list[float]](list)
    wall_s = cpu_s = other_s = 0.0
    warm = at_rest = searched = 0
    Stopwatch.processor_time = rate_hz is not None
    for slam, frames in drive_chunks(open_drive):
        if warm < warm_up:
            for frame in frames[: warm_up - warm]:
                slam.step(frame)
            frames, warm = frames[warm_up - warm :], warm + len(frames)
        own, other, start = time.process_time(), _machine_s(), time.perf_counter()
        for index, frame in enumerate(frames):
            if rate_hz is not None:
                time.sleep(max(0.0, start + index / rate_hz - time.perf_counter()))
            before = time.perf_counter()
            result = slam.step(frame)
            slam.objects()
            at_rest += result.observed.at_rest
            searched += result.observed.searched
            totals.append((time.perf_counter() - before) * 1e3)
            for stage, stage_ms in result.stages_ms.items():
                stages[stage].append(stage_ms)
        if rate_hz is not None:
            time.sleep(max(0.0, start + len(frames) / rate_hz - time.perf_counter()))
        spent = time.process_time() - own
        cpu_s, wall_s = cpu_s + spent, wall_s + time.perf_counter() - start
        other_s += _machine_s() - other - spent
        if wall_s >= seconds:
            break
    Stopwatch.processor_time = False
    stage_times = (
        {"stages_ms": {stage: percentiles(laps) for stage, laps in stages.items()}}
        if rate_hz is None
        else {"stages_cpu_ms": {stage: round(sum(laps) / len(totals), 3) for stage, laps in stages.items()}}
    )
    return {
        "fps": round(len(totals) / wall_s, 2),
        "searched_hz": round(searched / wall_s, 2),
        "frames": len(totals),
        "at_rest": at_rest,
        "latency_ms": percentiles(totals),
        **stage_times,
        "cpu_ms_per_frame": round(1e3 * cpu_s / len(totals), 2),
        "cpu_percent": round(100.0 * cpu_s / wall_s, 1),
        "other_cpu_percent": round(max(0.0, 100.0 * other_s / wall_s), 1),
    }


def in_turn(
    rounds: Iterable[Mapping[str, Callable[[], object]]], rest_s: float = 0.0
) -> dict[str, tuple[float, float]]:
    """Median wall time, and processor time of all threads, ms, of calls that run in turn, every second round
    backwards; the first two rounds do not count. rest_s: after each call, so that its spinning threads do not slow the
    next one; their use of it is counted."""
    laps_ms = defaultdict[str, list[tuple[float, float]]](list)
    for number, calls in enumerate(rounds):
        for name, call in list(calls.items())[:: 1 if number % 2 else -1]:
            spent, before = time.process_time(), time.perf_counter()
            call()
            took = time.perf_counter() - before
            time.sleep(rest_s)
            if number >= 2:
                laps_ms[name].append((1e3 * took, 1e3 * (time.process_time() - spent)))
    return {name: tuple(np.median(laps, axis=0).tolist()) for name, laps in laps_ms.items()}


def soak(open_drive: OpenDrive, minutes: float, rate_hz: float) -> dict[str, Any]:
    """Runs paced for some minutes. Returns the cost of each minute, and the growth of the process after the first."""
    rows = []
    for _ in range(max(1, round(minutes))):
        row = measure(open_drive, 60.0 * min(1.0, minutes), rate_hz)
        kept = {key: row[key] for key in ("frames", "latency_ms", "cpu_ms_per_frame", "other_cpu_percent")}
        rows.append(kept | {"rss_mb": round(psutil.Process().memory_info().rss / 1e6, 1)})
    return {"minutes": rows, "rss_growth_mb": round(rows[-1]["rss_mb"] - rows[0]["rss_mb"], 1)}


def _machine_s() -> float:
    """Processor seconds of everything on this machine, and what its host took from it."""
    times = psutil.cpu_times()
    return sum(times) - times.idle - getattr(times, "iowait", 0.0) - getattr(times, "guest", 0.0)


NOISE = 2.0  # grey levels a pixel, standard deviation
PICTURES = 16  # that differ, in turn
FALL_ASLEEP_S = 3.0  # before the clock starts


def standing_camera(camera: Camera, rate_hz: float) -> FileCamera:
    """The first picture of a camera for ever, each time with other noise and as a JPEG that is decoded, as a USB
    camera delivers it; no wheels and no IMU. Raises CameraError where there is no first picture.
    """
    info = replace(camera.info, wheel=None, imu=None)
    with camera:
        first = next_frame(camera, lambda _: None)
    if first is None:
        raise CameraError(f"{info.name}: no frames")
    random, start_s = np.random.default_rng(0), first.stamp_s
    noisy = (first.image + random.normal(0.0, NOISE, first.image.shape) for _ in range(PICTURES))
    jpegs = [cv2.imencode(".jpg", np.clip(one, 0, 255).astype(np.uint8))[1].tobytes() for one in noisy]
    pictures = (decode_picture(jpeg, info.name) for jpeg in cycle(jpegs))
    shots = (Picture(start_s + row / rate_hz, one, None, info.name) for row, one in enumerate(pictures))
    return FileCamera(info, shots)


def measure_at_rest(open_standing: OpenDrive, seconds: float, rate_hz: float) -> dict[str, Any]:
    """Processor time at rest: `cpu_percent` (of one core) and `cpu_ms_per_frame` of the step, with the decoding of the
    picture in `cpu_percent_with_decoding`; frames at rest while the clock ran. open_standing: a drive of a
    `standing_camera`."""
    found = measure(open_standing, seconds, rate_hz, warm_up=round(FALL_ASLEEP_S * rate_hz))
    kept = {key: found[key] for key in ("frames", "at_rest", "cpu_ms_per_frame", "cpu_percent", "stages_cpu_ms")}
    camera, _ = open_standing()
    with camera:
        start = time.process_time()
        for _ in range(PICTURES):
            camera.read()
        decode_ms = 1e3 * (time.process_time() - start) / PICTURES
    whole = found["cpu_percent"] + 0.1 * decode_ms * rate_hz
    return kept | {"decode_ms": round(decode_ms, 3), "cpu_percent_with_decoding": round(whole, 1)}
