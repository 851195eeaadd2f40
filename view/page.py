"""The sink of the live page. It keeps the newest result, and the history for viewers that connect late."""

import json
import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path
from typing import Any, Generic, TypeVar

import numpy as np

from edgemap.geometry.grid.occupancy_grid import OccupancyGrid
from edgemap.geometry.map_object import MapObject, ellipse_95
from edgemap.geometry.objects.annotations import NO_ANNOTATIONS, Annotations
from edgemap.geometry.objects.scale import scaled_map
from edgemap.geometry.objects.zone_watch import ZoneEvent, ZoneWatch
from edgemap.geometry.se2 import SE2
from edgemap.runtime.frames.faults import Fault, FaultKind
from edgemap.runtime.outputs.verdict.verdict import Verdict
from edgemap.runtime.step.edit_queue import Edits
from edgemap.runtime.step.map_file import map_document, save_map
from edgemap.runtime.step.pose_journal import PoseJournal
from edgemap.runtime.step.slam import StepResult
from edgemap.view.pause import Pause
from edgemap.view.report.crops import BestCrops

T = TypeVar("T")
TRAIL_STEP_M = 0.03
MOVED_M = 0.1  # loop corrections after which the trail is sent again
RATE_OVER = 20  # frames over which the frame rate is averaged


class Tail(Generic[T]):
    """The last `limit` of all appended items, numbered from 0."""

    def __init__(self, limit: int) -> None:
        self._items: deque[T] = deque(maxlen=limit)
        self._total = 0
        self._lock = threading.Lock()

    def append(self, item: T) -> None:
        """Adds an item, and drops the oldest beyond the limit."""
        with self._lock:
            self._items.append(item)
            self._total += 1

    def replace(self, change: Callable[[T], T]) -> None:
        """Replaces each item by its changed version."""
        with self._lock:
            self._items = deque(map(change, self._items), maxlen=self._items.maxlen)

    def all(self) -> list[T]:
        """All stored items, oldest first."""
        return list(self._items)

    @property
    def total(self) -> int:
        """Number of items appended so far."""
        return self._total

    def since(self, number: int, most: int) -> tuple[list[T], int]:
        """At most `most` items from `number` on, oldest first, and the number of the next one."""
        with self._lock:
            oldest = self._total - len(self._items)
            first = min(max(number, oldest), self._total)
            items = list(islice(self._items, first - oldest, first - oldest + most))
        return items, first + len(items)


@dataclass(frozen=True, slots=True)
class PageSnapshot:
    """The data of one step that the page keeps: references, no copies. arrived_s: `time.monotonic`."""

    result: StepResult
    objects: list[MapObject]
    annotations: Annotations
    arrived_s: float


class LivePage:
    """A sink that never blocks: `write` stores references and wakes the server's thread if a viewer waits.

    about: description of the run for the page (plain JSON values). folder: where `save` writes. pause: None for live
    cameras. camera_state: running, degraded or lost. crops: the best picture of each object, collected by the report.
    edits: receives the edits of viewers. pictures: whether anything of the camera's pictures may leave.
    """

    name = "live page"

    def __init__(
        self,
        about: dict[str, Any],
        folder: Path,
        pause: Pause | None = None,
        camera_state: Callable[[], str] = lambda: "running",
        crops: BestCrops | None = None,
        edits: Edits | None = None,
        pictures: bool = True,
    ) -> None:
        self.about, self.folder, self.pause, self.camera_state = about, folder, pause, camera_state
        self.pictures = pictures
        self.crops = BestCrops() if crops is None else crops
        self.edits = edits or Edits()
        self.edits.listeners.append(self.edited)
        self.searching: Callable[[], bool] = bool  # whether the robot is not yet localised in a saved map
        self.verdict: Callable[[], Verdict | None] = lambda: None  # how far the map can be trusted
        # Saves height, m, and pitch, degrees, to camera.yaml.
        self.keep_mount: Callable[[float, float], Path] | None = None
        self.goals: list[Callable[[SE2], None]] = []  # receivers of a goal pose
        self.camera_hz: Callable[[], float | None] = lambda: self.about.get("rate_hz")  # of the camera, as measured
        self.newest: PageSnapshot | None = None
        self.revision = 0
        self.epoch = 0  # increases when everything sent before has moved
        self.finished = False
        self.trail: Tail[tuple[float, float, float, float]] = Tail(20_000)  # x_m, y_m, stamp_s, 95 % radius in m
        self.sightings: Tail[tuple[str, str, float, float]] = Tail(20_000)
        self.faults: Tail[Fault] = Tail(100)  # each with the index of the frame at which it began
        self.events: Tail[ZoneEvent] = Tail(100)
        self._zone_watch = ZoneWatch()
        self._sightings_base: deque[tuple[float, float, float]] = deque(maxlen=20_000)  # stamp_s, x_m, y_m
        self._moved_m = 0.0  # since everything was sent
        self._arrivals_s: deque[float] = deque(maxlen=RATE_OVER)
        self._step_ms: deque[float] = deque(maxlen=RATE_OVER)
        self.last_fault: tuple[Fault, float] | None = None  # and when it was reported, by `time.monotonic`
        self._fault_frames: dict[FaultKind, int] = {}  # in which each kind was reported last
        self._trail_end: tuple[float, float] | None = None
        self._wake: Callable[[], None] | None = None

    def write(self, result: StepResult, objects: list[MapObject]) -> None:
        """Replaces the stored result with the result of this step."""
        now_s = time.monotonic()
        self._arrivals_s.append(now_s)
        self._step_ms.append(sum(result.stages_ms.values()))
        self._moved_m += result.correction.moved_m if result.correction else 0.0
        if result.relocated is not None or self._moved_m > MOVED_M:
            self._send_again(result.trajectory)
        self._extend_trail(result)
        for placed, identity in zip(result.sightings, result.object_ids, strict=True):
            x_m, y_m = placed.position_map_m
            self.sightings.append((placed.label, identity, float(x_m), float(y_m)))
            x_base_m, y_base_m = placed.sighting.position_base_m
            self._sightings_base.append((placed.sighting.stamp_s, float(x_base_m), float(y_base_m)))
        self.newest = PageSnapshot(result, objects, result.annotations, now_s)
        for event in self._zone_watch.update(objects, result.annotations.zones, result.frame.stamp_s):
            self.events.append(event)
        self._changed()

    last = write

    def edited(self, objects: list[MapObject], annotations: Annotations) -> None:
        """Stores the map after a person has edited it between two steps."""
        if self.newest is not None:
            self.newest = replace(self.newest, objects=objects, annotations=annotations)
            self._changed()

    def fault(self, fault: Fault) -> None:
        """Show a fault on the page, once while its kind is reported in every frame."""
        frame = self.newest.result.frame.index if self.newest else 0
        lasts = self._fault_frames.get(fault.kind) == frame - 1
        self._fault_frames[fault.kind] = frame
        self.last_fault = fault, time.monotonic()
        if not lasts:
            self.faults.append(replace(fault, frame=frame))
        self._changed()

    def close(self) -> None:
        """Marks the run as ended; the page keeps showing its last state."""
        self.finished = True
        self._changed()

    def wake_once(self, call: Callable[[], None]) -> None:
        """Registers a function that the run's thread calls once, at the next change. The function must not block."""
        self._wake = call

    def set_paused(self, paused: bool) -> None:
        """Pauses or resumes the run, if its camera can wait."""
        if self.pause is not None and not self.finished:
            self.pause.set(paused)
            self._arrivals_s.clear()
            self._changed()

    @property
    def state(self) -> str:
        """`running`, `paused` or `finished`."""
        if self.finished:
            return "finished"
        return "paused" if self.pause is not None and self.pause.paused else "running"

    @property
    def objects(self) -> list[MapObject]:
        """The objects of the map after the newest step."""
        return self.newest.objects if self.newest else []

    @property
    def annotations(self) -> Annotations:
        """Zones and deleted objects."""
        return self.newest.annotations if self.newest else NO_ANNOTATIONS

    @property
    def grid(self) -> OccupancyGrid | None:
        """The occupancy grid of the newest step. Steps update it once per second of stream time."""
        return self.newest.result.grid if self.newest else None

    def rate_hz(self) -> float | None:
        """Mean rate of the latest steps (at most `RATE_OVER`), in Hz; None before the second step."""
        arrivals = list(self._arrivals_s)
        span_s = arrivals[-1] - arrivals[0] if len(arrivals) > 1 else 0.0
        return (len(arrivals) - 1) / span_s if span_s > 0 else None

    def step_ms(self) -> float:
        """Mean time of the latest steps (at most `RATE_OVER`); 0 before the first."""
        return sum(self._step_ms) / max(len(self._step_ms), 1)

    @property
    def rate_known(self) -> bool:
        """Whether `rate_hz` is the mean of `RATE_OVER` steps, enough for a decision."""
        return len(self._arrivals_s) == RATE_OVER

    def map_text(self) -> str:
        """The map as the text of `map.json`."""
        return json.dumps(map_document(*self._saved_map()[:2]), indent=1) + "\n"

    def save(self) -> Path:
        """Writes the current map to a file of its own in the run folder, beside map.json. Raises MapError."""
        path = self.folder / f"map-{self.newest.result.frame.index if self.newest else 0:06d}.json"
        save_map(path, *self._saved_map())
        return path

    def _saved_map(self) -> tuple[list[MapObject], Annotations, OccupancyGrid | None]:
        """Objects, annotations and grid at the scale of a corrected lens height."""
        verdict, scale = self.verdict(), self.newest.result.scale if self.newest else 1.0
        annotations = verdict.on(self.annotations) if verdict else self.annotations
        return scaled_map(self.objects, annotations, self.grid, scale)

    def _send_again(self, trajectory: PoseJournal) -> None:
        """Sends trail and sightings again after the trajectory has moved."""
        self._moved_m = 0.0
        sent = self.trail.all()
        if not sent:
            return
        trail = iter(trajectory.at([stamp_s for _, _, stamp_s, _ in sent])[:, :2].ravel().tolist())
        self.trail.replace(lambda sample: (next(trail), next(trail), *sample[2:]))
        if self._sightings_base:
            stamps_s, *base_m = np.array(self._sightings_base).T
            seen_at = iter(trajectory.points(stamps_s, np.column_stack(base_m)).ravel().tolist())
            self.sightings.replace(lambda items: (*items[:2], next(seen_at), next(seen_at)))
        self.epoch += 1

    def _extend_trail(self, result: StepResult) -> None:
        x_m, y_m = result.pose_map_base.x_m, result.pose_map_base.y_m
        last = self._trail_end
        if last is None or abs(x_m - last[0]) + abs(y_m - last[1]) > TRAIL_STEP_M:
            self._trail_end = (float(x_m), float(y_m))
            self.trail.append((*self._trail_end, result.frame.stamp_s, ellipse_95(result.pose_covariance)[0]))

    def _changed(self) -> None:
        self.revision += 1
        wake, self._wake = self._wake, None
        if wake is not None:
            wake()
