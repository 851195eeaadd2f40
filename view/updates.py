"""The socket's messages: one binary message per update, JSON followed by the picture's JPEG."""

import math
import os
import struct
import time
from functools import lru_cache
from typing import Any

import psutil

from edgemap.geometry.grid.occupancy_grid import OccupancyGrid
from edgemap.geometry.grid.rooms import Room
from edgemap.geometry.map_object import MapObject
from edgemap.geometry.se2 import SE2
from edgemap.runtime.frames.frame import Frame, jpeg
from edgemap.runtime.step.slam import StepResult
from edgemap.view.answers import (
    event_answer,
    fault_answer,
    floor_answer,
    frame_answer,
    map_object_answer,
    plain,
    rooms_answer,
    zones_answer,
)
from edgemap.view.page import LivePage
from edgemap.view.report.crops import small
from edgemap.view.status import pose_sigma, status

JPEG_QUALITY = 75
LONGEST_PX = 960
MAXIMUM_ITEMS = 4000  # of a history in one update; the rest follows in the next ones


@lru_cache(maxsize=1)  # each frame is encoded once for all viewers
def shown_jpeg(frame: Frame) -> bytes:
    """The frame's picture as JPEG, at most `LONGEST_PX` wide and high."""
    return jpeg(small(frame.image, LONGEST_PX), JPEG_QUALITY)


class ProcessUsage:
    """This process's processor time and memory, read at most once a second."""

    def __init__(self) -> None:
        self._process = psutil.Process()
        self._process.cpu_percent()
        self._cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
        self._looked_s = -math.inf
        self._last: dict[str, float | None] = {"cpu_percent": None, "memory_mb": None}

    def now(self) -> dict[str, float | None]:
        """cpu_percent: share of all cores together, 0..100. memory_mb: resident memory."""
        now_s = time.monotonic()
        if now_s - self._looked_s >= 1.0:
            first = self._looked_s == -math.inf  # there is no interval yet
            share = self._process.cpu_percent() / self._cores
            memory_mb = self._process.memory_info().rss / 1e6
            self._last = {"cpu_percent": None if first else round(share, 1), "memory_mb": round(memory_mb, 1)}
            self._looked_s = now_s
        return self._last


class Cursor:
    """Tracks what one viewer has received, to send only changes."""

    def __init__(self) -> None:
        self.revision = -1
        self._with_sightings = False
        self._frame: Frame | None = None
        self._zones: list[dict[str, Any]] | None = None  # as sent
        self._dock: SE2 | str | None = "unsent"  # as sent
        self._grid: OccupancyGrid | None = None  # as sent
        self._rooms: tuple[Room, ...] = ()  # named ones, as sent
        self._objects: dict[str, MapObject] = {}
        self._trail = self._sightings = self._faults = self._epoch = 0
        self._events = -1  # none of those before the first update

    def want_sightings(self, wanted: bool) -> None:
        """Whether to send all sightings from the first one, or none."""
        self._with_sightings, self._sightings, self.revision = wanted, 0, -1

    def update(self, page: LivePage, usage: ProcessUsage, number: int) -> bytes:
        """The next message: all changes since the previous one."""
        self.revision = page.revision
        moved, self._epoch = self._epoch != page.epoch, page.epoch
        if moved:
            self._trail, self._sightings, self._objects, self._zones, self._grid = 0, 0, {}, None, None
        snapshot = page.newest
        trail, self._trail = page.trail.since(self._trail, MAXIMUM_ITEMS)
        faults, self._faults = page.faults.since(self._faults, MAXIMUM_ITEMS)
        events, self._events = page.events.since(
            self._events if self._events >= 0 else page.events.total, MAXIMUM_ITEMS
        )
        document: dict[str, Any] = {
            "number": number, "state": page.state, "camera_state": page.camera_state(), "moved": moved,
            "status": status(page), "trail": trail, "faults": [fault_answer(fault) for fault in faults],
            "events": [event_answer(event) for event in events],
            "vitals": usage.now(),
        }  # fmt: skip
        if self._with_sightings:
            document["sightings"], self._sightings = page.sightings.since(self._sightings, MAXIMUM_ITEMS)
        picture = b""
        if snapshot is not None:
            zones = zones_answer(page.annotations.zones, page.objects)
            if zones != self._zones:
                document["zones"] = self._zones = zones
            dock = page.annotations.dock
            if moved or self._dock == "unsent" or dock != self._dock:
                self._dock, document["dock"] = dock, dock and list(dock.vector())
            if (grid := snapshot.result.grid) is not None:
                if grid is not self._grid or page.annotations.rooms != self._rooms:
                    document |= rooms_answer(page.objects, page.annotations, grid)
                    self._rooms = page.annotations.rooms
                if grid is not self._grid:
                    document["floor"], self._grid = floor_answer(grid), grid
            document |= _step(snapshot.result) | self._object_changes(snapshot.objects)
            document |= {"rate_hz": page.rate_hz(), "age_s": time.monotonic() - snapshot.arrived_s}
            if snapshot.result.frame is not self._frame:
                self._frame = snapshot.result.frame
                picture = shown_jpeg(self._frame) if page.pictures else b""
        head = plain(document)
        return struct.pack("<I", len(head)) + head + picture

    def _object_changes(self, objects: list[MapObject]) -> dict[str, Any]:
        """The map makes a new MapObject for each change, so identity shows which objects changed."""
        now = {item.id: item for item in objects}
        changed = [item for key, item in now.items() if self._objects.get(key) is not item]
        gone = [key for key in self._objects if key not in now]
        self._objects = now
        return {"changed": [map_object_answer(item) for item in changed], "gone": gone}


def _step(result: StepResult) -> dict[str, Any]:
    pose = result.pose_map_base
    return frame_answer(result) | {
        "pose": [float(pose.x_m), float(pose.y_m), float(pose.yaw_rad)],
        "pose_sigma": pose_sigma(result),
        "pose_covariance": result.pose_covariance.tolist(),
    }
