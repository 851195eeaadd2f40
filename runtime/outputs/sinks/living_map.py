"""A map that lives on over runs: saved back while the robot drives, with the pose from which the next run starts."""

import os
from collections.abc import Callable
from pathlib import Path

from edgemap.geometry.grid.occupancy_grid import OccupancyGrid
from edgemap.geometry.map_object import MapObject
from edgemap.geometry.objects.annotations import Annotations
from edgemap.geometry.objects.scale import scaled_map
from edgemap.geometry.se2 import SE2
from edgemap.runtime.frames.disk import lock_folder
from edgemap.runtime.frames.timing import StreamTimer
from edgemap.runtime.step.grid_file import grid_name, save_grid
from edgemap.runtime.step.map_file import map_document, replace_map, saved_text
from edgemap.runtime.step.sinks import Sink
from edgemap.runtime.step.slam import StepResult

SAVE_EVERY_S = 0.75  # of stream, as the run folder


class LivingMap(Sink):
    """Writes `map.json` of a folder that several runs share, one after the other: objects, annotations, last pose.

    searching: whether the robot is not yet relocalised in the map; nothing is written until then, so a run without
    relocalisation leaves the map unchanged. A new map takes the scale of a corrected lens height once, at the end. The
    folder is locked while the run lasts; `map.before.json` keeps the map of the run before.
    Raises DiskError where the folder cannot be made, RunFolderError where another run uses it.
    """

    def __init__(self, folder: Path, searching: Callable[[], bool]) -> None:
        self.name = f"map {folder}"
        self.path = folder / "map.json"
        self._searching = searching
        self._state: tuple[list[MapObject], Annotations, SE2, OccupancyGrid | None] | None = None
        self._saved_grid: tuple[OccupancyGrid, float] | None = None  # and its scale
        self._scale, self._closed = 1.0, False
        self._written: dict | None = None
        self._save_timer = StreamTimer(SAVE_EVERY_S)
        self._lock: int | None = lock_folder(folder, "another run uses this map")

    def write(self, result: StepResult, objects: list[MapObject]) -> None:
        """Save by the stream's time. Raises DiskError."""
        self._state = (objects, result.annotations, result.pose_map_base, result.grid)
        self._scale = result.scale
        if self._save_timer.due(result.frame.stamp_s):
            self._save()

    def edited(self, objects: list[MapObject], annotations: Annotations) -> None:
        """The map as a person has just edited it, saved at once; also after the run. Raises DiskError."""
        if self._state is not None:
            self._state = (objects, annotations, *self._state[2:])
            self._save()

    def close(self) -> None:
        """Save for good; edits of the page that stays are still saved. Raises DiskError."""
        self._closed = True
        self._save()

    def release(self) -> None:
        """Let another run have the folder."""
        lock, self._lock = self._lock, None
        if lock is not None:
            os.close(lock)

    def _save(self) -> None:
        """Nothing is written where nothing changed: a robot at rest leaves its disk alone."""
        if self._state is None or self._searching():
            return
        live_objects, live_annotations, pose, live_grid = self._state
        scale = self._scale if self._closed else 1.0
        objects, annotations, grid = scaled_map(live_objects, live_annotations, live_grid, scale)
        if live_grid is not None and grid is not None and (live_grid, scale) != self._saved_grid:
            save_grid(self.path.with_name(grid_name(self.path)), grid)
            self._saved_grid = (live_grid, scale)
        document = map_document(objects, annotations, grid, last_pose=pose.scaled(scale))
        if document != self._written:
            replace_map(self.path, saved_text(document), keeps_before=self._written is None)
            self._written = document
