"""A day of driving round and round a room, a step for each second of stream: does anything grow, is the map true?"""

import gc
import math
import time
from collections import Counter
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import psutil
from support.fuzzed_room import pose_at

from edgemap.evaluation.objects import TrueObject, score_map
from edgemap.geometry.map_object import MapObject
from edgemap.geometry.observations.detections import Detections
from edgemap.geometry.observations.sighting import Sighting
from edgemap.geometry.se2 import SE2
from edgemap.runtime.motion.odometry.protocol import Motion
from edgemap.runtime.motion.odometry.recorded import WHEEL
from edgemap.runtime.step.frame_observations import FrameObservations
from edgemap.runtime.step.map_file import map_document, saved_text
from edgemap.runtime.step.mapper import Mapper
from reliability.parts import PartReport

DAY_S, PIECES = 86_400, 24
LABELS = ("chair", "couch", "potted plant", "refrigerator", "toilet")
HALF_VIEW_RAD, NEAREST_M, FARTHEST_M = math.radians(35.0), 0.6, 5.0
LIMIT_S = 1800.0  # of processor time for the whole day
SPEED_M_S = 0.25
SIGMA_SHARE = 0.04  # of an object's distance
LONG_MS = 30.0  # a step that takes longer is told one by one
GROWTH = 1.25  # of step time and map size, last quarter of the day over the second one
GROWTH_MB = 16.0  # of memory, likewise
F1_LOSS = 0.1  # likewise


def run(seed: int, share: float, out: Path) -> PartReport:
    """The real back end, loop closure included; what the front end gives is drawn from a room of 14 objects."""
    steps = max(PIECES, round(DAY_S * share))
    rows = drive_through(Mapper(closes_loops=True), RoundTrip(seed), steps, PIECES, 24.0, LIMIT_S * share)
    return _report(rows)


class Source(Protocol):
    """What a front end would give of a drive, and how true a map of it is."""

    def step(self) -> FrameObservations:
        """The next frame."""
        ...

    def f1(self, objects: list[MapObject]) -> float:
        """Of a map, among all that came into view so far."""
        ...


def drive_through(
    mapper: Mapper, source: Source, steps: int, pieces: int, hours: float, limit_s: float, rate_hz: int = 1
) -> list[dict[str, Any]]:
    """Figures of each piece of a drive of so many steps and hours; fewer pieces where its processor time runs out.

    step_ms, p50_ms, p99_ms, largest_ms: processor time of a step of the back end, and of asking it for the map once a
    second, as a run does. long: the steps over 30 ms, each with its number, its stage that took longest, and whether a
    loop closure corrected the trajectory in it. What the source holds is none of the robot's, so the garbage collector
    leaves it alone.
    """
    gc.collect()
    gc.freeze()
    process, rows, begun_s = psutil.Process(), list[dict[str, Any]](), time.process_time()
    times_ms, long, objects = list[float](), list[dict[str, Any]](), list[MapObject]()
    for step in range(steps):
        observed = source.step()
        started_s = time.process_time()
        update = mapper.step(observed)
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
                "f1": source.f1(objects),
            }
            print(", ".join(f"{name} {value:.2f}" for name, value in row.items()), flush=True)
            rows.append(row | {"long": long})
            times_ms, long = [], []
            if time.process_time() - begun_s > limit_s:
                break
    return rows


class RoundTrip:
    """Round and round: what a front end would give of each step. room: (label, x_m, y_m)."""

    def __init__(self, seed: int) -> None:
        self._random, self._steps = np.random.default_rng(seed), 0
        angles = np.sort(self._random.uniform(0, 2 * math.pi, 14))
        self._seen: Counter[int] = Counter()
        self.room = [(LABELS[i % 5], 4.5 * math.cos(a), 3.5 * math.sin(a)) for i, a in enumerate(angles)]

    def f1(self, objects: list[MapObject]) -> float:
        """Of a map, in the frame of the first pose: one to one by class within 0.5 m, among all that came into view."""
        start = _pose(0).inverse()
        truth = []
        for number, (label, *place) in enumerate(self.room):
            x_m, y_m = start.apply(place)
            truth.append(TrueObject(label, float(x_m), float(y_m), True, self._seen[number]))
        return float(score_map(objects, truth)["f1"] or 0.0)

    def step(self) -> FrameObservations:
        """The next second."""
        pose, before = _pose(self._steps), _pose(max(self._steps - 1, 0))
        self._steps += 1
        observed, seen = _observed(self._steps - 1, pose, before, self.room, self._random)
        self._seen.update(seen)
        return observed


def _pose(step: int) -> SE2:
    return pose_at(SPEED_M_S * step)


def _observed(
    step: int, pose: SE2, before: SE2, room: list[tuple[str, float, float]], random: np.random.Generator
) -> tuple[FrameObservations, list[int]]:
    """The observations, and which objects of the room they are of."""
    inverse, sightings, boxes, numbers = pose.inverse(), [], [], []
    for number, (label, x_m, y_m) in enumerate(room):
        at = inverse.apply(np.array([x_m, y_m]))
        distance_m = float(np.hypot(*at))
        if not NEAREST_M < distance_m < FARTHEST_M or abs(math.atan2(at[1], at[0])) > HALF_VIEW_RAD:
            continue
        sigma_m = SIGMA_SHARE * distance_m
        small = sigma_m**2 * np.eye(2)
        size = (0.5, 0.9, 0.5)
        seen = at + random.normal(0.0, sigma_m, 2)
        sightings.append(
            Sighting(label, 0.9, seen, small, 0.1 * small, *size, distance_m, len(boxes), step, float(step))
        )
        numbers.append(number)
        left = 320.0 - 400.0 * at[1] / at[0]
        boxes.append([left - 40.0, 150.0, left + 40.0, 350.0])
    classes = np.array([LABELS.index(item.label) for item in sightings], dtype=np.int64)
    detections = Detections(np.array(boxes).reshape(-1, 4), np.full(len(boxes), 0.9), classes, LABELS)
    true = before.inverse() @ pose
    covariance = WHEEL.covariance(true)
    noise = random.multivariate_normal(np.zeros(3), covariance)
    motion = Motion(SE2(*(true.vector() + noise)), covariance)
    return FrameObservations(step, float(step), detections, sightings, motion), numbers


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
