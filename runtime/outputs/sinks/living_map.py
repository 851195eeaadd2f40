"""A map that lives on over runs: saved back while the robot drives, with the pose from which the next run starts."""

import os
from collections.abc import Callable
from pathlib import Path

from edgemap.geometry.errors import MapError
from edgemap.geometry.map_object import MapObject
from edgemap.geometry.objects.annotations import NO_ANNOTATIONS, Annotations
from edgemap.geometry.objects.scale import scaled_map
from edgemap.runtime.frames.disk import SAVE_EVERY_S, lock_folder, write_atomically
from edgemap.runtime.frames.reading import read_bytes
from edgemap.runtime.frames.timing import StreamTimer
from edgemap.runtime.outputs.verdict.verdict import Verdict
from edgemap.runtime.step.grid_file import grid_name, save_grid
from edgemap.runtime.step.map_file import load_annotated_map, map_document, replace_map, saved_text
from edgemap.runtime.step.sinks import Sink
from edgemap.runtime.step.slam import StepResult


class LivingMap(Sink):
    """Writes `map.json` of a folder that several runs share, one after the other: objects, annotations, last pose.

    folder: or what gives it once it is known, which is asked and then opened by `write`. searching: whether the robot
    is not yet relocalised in the map; nothing is written until then, so a run without relocalisation leaves the map
    unchanged. verdict: on the run so far; complete: called before the last one. While it is unreliable and the earlier
    map was not, or the run was placed wrongly in it, that map stays, and this run's is written as
    `map.unreliable.json`. A new map takes the scale of a corrected lens height once, at the end. The folder is locked
    while the run lasts; `map.before.json` keeps the map of the run before. Raises DiskError where the folder cannot be
    made, RunFolderError where another run uses it.
    """

    def __init__(
        self,
        folder: Path | Callable[[], Path | None],
        searching: Callable[[], bool],
        verdict: Callable[[], Verdict] = lambda: Verdict("care"),
        complete: Callable[[], None] = lambda: None,
    ) -> None:
        self.name = f"map {folder}" if isinstance(folder, Path) else "map of the place"
        self.path = Path("map.json")
        self._folder = folder
        self._searching, self._verdict, self._complete = searching, verdict, complete
        self._result: StepResult | None = None  # the newest
        self._map: tuple[list[MapObject], Annotations] = [], NO_ANNOTATIONS
        self._saved_grid: int | None = None  # its sum
        self._closed = False
        self._written: dict | None = None
        self._replaced = False  # the map of the runs before, which is kept once
        self._save_timer = StreamTimer(SAVE_EVERY_S)
        self._lock: int | None = None
        self._earlier: dict[Path, bytes] = {}  # files of the map of the runs before
        self._is_better = False  # than an unreliable one
        self.beside = ""  # where this run's map was saved instead, in one line
        if isinstance(folder, Path):
            self._open(folder)

    def _open(self, folder: Path) -> None:
        self._lock = lock_folder(folder, "another run uses this map, or its page is still open")
        self.path = folder / "map.json"
        if not self.path.is_file():
            return
        identity = load_annotated_map(self.path)[1].identity
        self._is_better = identity is None or identity.level != "unreliable"
        files = (self.path.with_name(grid_name(self.path)), self.path)
        self._earlier = {path: read_bytes(path, MapError) for path in files if path.is_file()}

    def write(self, result: StepResult, objects: list[MapObject]) -> None:
        """Save by the stream's time. Raises DiskError, or RunFolderError where another run uses the found folder."""
        if self._lock is None and not isinstance(self._folder, Path):
            if (found := self._folder()) is None:
                return
            self._open(found)
        self._result, self._map = result, (objects, result.annotations)
        if self._save_timer.due(result.frame.stamp_s):
            self._save()

    last = write

    def edited(self, objects: list[MapObject], annotations: Annotations) -> None:
        """The map as a person has just edited it, saved at once; also after the run. Raises DiskError."""
        self._map = objects, annotations
        self._save()

    def close(self) -> None:
        """Save for good; edits of the page that stays are still saved. Raises DiskError."""
        self._closed = True
        self._complete()
        self._save()

    def release(self) -> None:
        """Let another run have the folder."""
        lock, self._lock = self._lock, None
        if lock is not None:
            os.close(lock)

    def _choose(self, verdict: Verdict) -> None:
        """Where to save: next to a better map, or in its place."""
        worse = verdict.misplaced or (self._is_better and verdict.level == "unreliable")
        apart = bool(self._earlier) and worse
        path = self.path.with_name("map.unreliable.json" if apart else "map.json")
        if path == self.path:
            return
        if apart and self._written is not None:
            for file, data in self._earlier.items():
                write_atomically(file, data)
        elif not apart:
            self.path.unlink(missing_ok=True)
            self.path.with_name(grid_name(self.path)).unlink(missing_ok=True)
        stays = path.with_name("map.json")
        self.beside = f"not reliable: {stays} stays as it was, this run's map is {path}" if apart else ""
        self.path, self._written, self._saved_grid = path, None, None

    def _save(self) -> None:
        """Nothing is written where nothing changed: a robot at rest leaves its disk alone."""
        if (result := self._result) is None or self._searching():
            return
        verdict = self._verdict()
        self._choose(verdict)
        scale, (objects, annotations) = result.scale if self._closed else 1.0, self._map
        objects, annotations, grid = scaled_map(objects, verdict.on(annotations), result.grid, scale)
        beside = self.path.with_name(grid_name(self.path))
        document = map_document(objects, annotations, grid, beside.name, result.pose_map_base.scaled(scale))
        if grid is not None and document["grid_sum"] != self._saved_grid:
            save_grid(beside, grid)
            self._saved_grid = document["grid_sum"]
        if document != self._written:
            replace_map(self.path, saved_text(document), keeps_before=not self._replaced and not self.beside)
            self._written, self._replaced = document, self._replaced or not self.beside
