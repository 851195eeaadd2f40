"""A day of driving round and round a room, a step for each second of stream: does anything grow, is the map true?"""

import gc
import math
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import psutil
from support.drives import observed, sighted
from support.fuzzed_room import pose_at

from edgemap.evaluation.objects import TrueObject, score_map
from edgemap.geometry.map_object import MapObject
from edgemap.geometry.se2 import SE2
from edgemap.runtime.motion.odometry.protocol import Motion
from edgemap.runtime.motion.odometry.recorded import WHEEL
from edgemap.runtime.step.frame_observations import FrameObservations
from edgemap.runtime.step.map_file import map_document, saved_text
from edgemap.runtime.step.mapper import Mapper
from reliability.parts import PartReport

DAY_S, PIECES = 86_400, 24
LABELS = ("chair", "couch", "potted plant", "refrigerator", "toilet")
LIMIT_S = 1800.0  # of processor time for the whole day
SPEED_M_S = 0.25
SIGMA_M = 0.1  # of a sighting, either way
LONG_MS = 30.0  # a step that takes longer is told one by one
GROWTH = 1.25  # of step time and map size, last quarter of the day over the second one
GROWTH_MB = 16.0  # of memory, likewise
F1_LOSS = 0.1  # likewise


def run(seed: int, share: float, out: Path) -> PartReport:
    """The real back end, loop closure included; what the front end gives is drawn from a room of 14 objects."""
    steps = max(PIECES, round(DAY_S * share))
    trip = RoundTrip(seed)
    rows = drive_through(Mapper(closes_loops=True), trip.step, trip.f1, steps, PIECES, 24.0, LIMIT_S * share)
    return _report(rows)


def drive_through(
    mapper: Mapper,
    observations: Callable[[], FrameObservations],
    f1: Callable[[list[MapObject]], float],
    steps: int,
    pieces: int,
    hours: float,
    limit_s: float,
    rate_hz: int = 1,
) -> list[dict[str, Any]]:
    """Figures of each piece of a drive of so many steps and hours; fewer pieces where its processor time runs out.
    observations: what a front end would give of the next frame. f1: how true a map is, among all that came into view.

    step_ms, p50_ms, p99_ms, largest_ms: processor time of a step of the back end, and of asking it for the map once a
    second, as a run does. long: the steps over 30 ms, each with its number, its stage that took longest, and whether a
    loop closure corrected the trajectory in it. What they hold is none of the robot's, so the garbage collector
    leaves it alone.
    """
    gc.collect()
    gc.freeze()
    process, rows, begun_s = psutil.Process(), list[dict[str, Any]](), time.process_time()
    times_ms, long, objects = list[float](), list[dict[str, Any]](), list[MapObject]()
    for step in range(steps):
        seen = observations()
        started_s = time.process_time()
        update = mapper.step(seen)
        if step % rate_hz == 0:
            objects = mapper.objects()
        times_ms.append(1000.0 * (time.process_time() - started_s))
        if times_ms[-1] > LONG_MS:
            stage = max(update.stages_ms, key=lambda name: update.stages_ms[name])
            long.append({"step": step, "ms": times_ms[-1], "stage": stage, "corrected": update.correction is not None})
        if (step + 1) % (steps // pieces) == 0:
            gc.collect()
            objects = mapper.objects()
            row = {
                "hour": hours * (step + 1) / steps,
                "step_ms": float(np.mean(times_ms)),
                "p50_ms": float(np.percentile(times_ms, 50)),
                "p99_ms": float(np.percentile(times_ms, 99)),
                "largest_ms": max(times_ms),
                "rss_mb": process.memory_info().rss / 1e6,
                "objects": len(objects),
                "map_kb": len(saved_text(map_document(objects))) / 1e3,
                "f1": f1(objects),
            }
            print(", ".join(f"{name} {value:.2f}" for name, value in row.items()), flush=True)
            rows.append(row | {"long": long})
            times_ms, long = [], []
            if time.process_time() - begun_s > limit_s:
                break
    return rows


class RoundTrip:
    """Round and round a room of 14 objects: what a front end would give of each second."""

    def __init__(self, seed: int) -> None:
        self._random, self._steps = np.random.default_rng(seed), 0
        angles = np.sort(self._random.uniform(0, 2 * math.pi, 14))
        self._room = [(LABELS[i % 5], 4.5 * math.cos(a), 3.5 * math.sin(a)) for i, a in enumerate(angles)]

    def f1(self, objects: list[MapObject]) -> float:
        """Of a map, in the frame of the first pose: one to one by class within 0.5 m, all seen within a lap."""
        places = pose_at(0.0).inverse().apply([(x_m, y_m) for _, x_m, y_m in self._room]).tolist()
        truth = [TrueObject(piece[0], x, y, True, 10) for piece, (x, y) in zip(self._room, places, strict=True)]
        return float(score_map(objects, truth)["f1"] or 0.0)

    def step(self) -> FrameObservations:
        """The next second."""
        step, stamp_s = self._steps, float(self._steps)
        self._steps += 1
        pose = pose_at(SPEED_M_S * step)
        true = pose_at(SPEED_M_S * max(step - 1, 0)).inverse() @ pose
        covariance = WHEEL.covariance(true)
        noise = self._random.multivariate_normal(np.zeros(3), covariance)
        motion = Motion(SE2(*(true.vector() + noise)), covariance)
        seen = sighted(self._room, pose, step, self._random, SIGMA_M, reach_m=5.0, half_rad=math.radians(35.0))
        return replace(observed(step, [replace(one, stamp_s=stamp_s) for one in seen], motion), stamp_s=stamp_s)


def _report(rows: list[dict[str, Any]]) -> PartReport:
    quarter = max(1, len(rows) // 4)
    early, late = rows[quarter : 2 * quarter], rows[-quarter:]

    def mean(part: list[dict[str, Any]], name: str) -> float:
        return float(np.mean([row[name] for row in part]))

    failures = [
        f"{name}: {mean(early, name):.2f} in the second quarter of the day, {mean(late, name):.2f} in the last"
        for name in ("step_ms", "objects", "map_kb")
        if mean(late, name) > GROWTH * mean(early, name)
    ]
    if mean(late, "f1") < mean(early, "f1") - F1_LOSS:
        failures.append(f"F1: {mean(early, 'f1'):.2f} in the second quarter, {mean(late, 'f1'):.2f} in the last")
    if len(rows) < PIECES:
        failures.append(f"the day took too long: {rows[-1]['hour']:.0f} of 24 h in {LIMIT_S} s of processor time")
    if mean(late, "rss_mb") - mean(early, "rss_mb") > GROWTH_MB:
        failures.append(f"memory: {mean(early, 'rss_mb'):.0f} MB, then {mean(late, 'rss_mb'):.0f} MB")
    return PartReport(tuple(failures), {"hours": rows})
