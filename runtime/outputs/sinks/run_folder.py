"""The run folder: map, trajectory, sightings and the run's record, on disk from the first second on."""

import json
import os
from collections import deque
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from time import perf_counter
from typing import Any

import cv2

from edgemap.geometry.camera.floor import FloorCamera
from edgemap.geometry.errors import EdgemapError
from edgemap.geometry.grid.occupancy_grid import OccupancyGrid
from edgemap.geometry.map_object import MapObject
from edgemap.geometry.objects.annotations import NO_ANNOTATIONS, Annotations
from edgemap.geometry.objects.scale import scaled_map
from edgemap.runtime.frames.disk import SAVE_EVERY_S, LineFile, lock_folder, write_atomically
from edgemap.runtime.frames.errors import DiskError, RunFolderError
from edgemap.runtime.frames.faults import Fault
from edgemap.runtime.frames.frame import jpeg
from edgemap.runtime.frames.timing import StreamTimer, percentiles
from edgemap.runtime.frames.trajectory import tum_line
from edgemap.runtime.outputs.sightings_file import rewrite, sighting_record
from edgemap.runtime.outputs.verdict.run_counts import RunCounts
from edgemap.runtime.outputs.verdict.verdict import Verdict
from edgemap.runtime.step.map_file import save_map
from edgemap.runtime.step.overlay import draw_floor_grid
from edgemap.runtime.step.slam import StepResult

IN_USE = "another run writes into it; choose another --out"
MAX_FAULTS = 200  # in run.json; the count goes on


class RunFolder:
    """Writes `map.json`, `trajectory.tum`, `sightings.jsonl`, `run.json` and `mount.jpg` into a new folder.

    record: the run's entries of run.json (configuration, sums, versions). An empty valid map exists at once. Trajectory
    and sightings are first written as estimated at the time; where loop closure or relocalisation moved the past, they
    are rewritten at the end. There all files take the scale of a corrected lens height, once. Data that the disk cannot
    take is kept and saved once it can. The folder is locked while the run lasts. Raises DiskError where the folder
    cannot be made, RunFolderError where it holds another run or another process writes into it.
    """

    name = "run folder"

    def __init__(self, folder: Path, camera: FloorCamera, record: dict[str, Any]) -> None:
        self.folder = folder
        self._camera, self._counts = camera, RunCounts(record)
        self._trajectory, self._sightings = LineFile(folder / "trajectory.tum"), LineFile(folder / "sightings.jsonl")
        self._result: StepResult | None = None  # the newest
        self._annotations = NO_ANNOTATIONS
        self._saved_grid: tuple[OccupancyGrid | None, float] = (None, 1.0)  # and its scale
        self._stage_times: dict[str, deque[float]] = {}  # of the latest 1,000 frames
        self._faults: list[dict[str, Any]] = []
        self.verdict = Verdict("care")  # of the newest save
        self.document: dict[str, Any] = {}  # run.json of the newest save
        self._rewritten_at = 0  # revision of the journal that the files show
        self._save_timer = StreamTimer(SAVE_EVERY_S)
        self._failure: EdgemapError | None = None  # of the newest save
        self._started = self._saved_at = perf_counter()
        self._closed = False
        self._lock = lock_folder(folder, IN_USE)
        try:
            if any(os.path.lexists(folder / name) for name in ("run.json", "trajectory.tum", "sightings.jsonl")):
                raise RunFolderError(f"{folder} already holds a run; choose another --out")
            self._write_all()
        except EdgemapError:
            os.close(self._lock)
            raise

    def add_record(self, entries: dict[str, Any]) -> None:
        """More entries of run.json, from the next save on."""
        self._counts.record = self._counts.record | entries

    def write(self, result: StepResult, objects: list[MapObject]) -> None:
        """Append pose and sightings; save everything by the stream's time.

        Raises DiskError, or RunFolderError where another run took the folder, from the save that fails until one does
        not.
        """
        if self._counts.frames == 0:
            picture = draw_floor_grid(result.frame.image, self._camera)
            with suppress(cv2.error, DiskError):
                write_atomically(self.folder / "mount.jpg", jpeg(picture))
        self._counts.write(result, objects)
        self._trajectory.append(tum_line(result.frame.stamp_s, result.pose_map_base))
        self.last(result, objects)
        for stage, time_ms in result.stages_ms.items():
            self._stage_times.setdefault(stage, deque(maxlen=1000)).append(time_ms)
        if result.relocated is not None or self._save_timer.is_due(result.frame.stamp_s):
            self._save(rewrites=result.relocated is not None)
        if self._failure is not None:
            raise self._failure

    def last(self, result: StepResult, objects: list[MapObject]) -> None:
        """The map of a result and its sightings, without a step."""
        self._result, self._annotations = result, result.annotations
        self._counts.last(result, objects)
        if (correction := result.correction) is not None:
            before = self._counts.record.get("corrections", {"count": 0, "largest_m": 0.0})
            largest_m = max(before["largest_m"], round(correction.moved_m, 4))
            noted = {"count": before["count"] + 1, "largest_m": largest_m, "seen_again": correction.links}
            self.add_record({"corrections": noted})
        if result.relocated is not None:
            start = result.relocated.vector().tolist()
            self.add_record({"relocated": {"frame": self._counts.frames, "pose_map_start": start}})
        for placed, identity in zip(result.sightings, result.object_ids, strict=True):
            record = sighting_record(result, placed, identity)
            self._sightings.append(json.dumps(record, allow_nan=False) + "\n")

    def fault(self, fault: Fault) -> None:
        """Records a fault with its frame; while a camera is disconnected, its faults trigger the saving."""
        self._counts.fault(fault)
        if len(self._faults) < MAX_FAULTS:
            self._faults.append(replace(fault, frame=self._counts.frames).document())
        if perf_counter() - self._saved_at > SAVE_EVERY_S and not self._closed:
            self._save(rewrites=False)

    def edited(self, objects: list[MapObject], annotations: Annotations) -> None:
        """The map as a person has just edited it, saved at once; also after the run. Raises DiskError."""
        self._counts.objects, self._annotations = objects, annotations
        self._save_map()

    def judge(self) -> Verdict:
        """The verdict on the map as it stands, newer than that of the newest save."""
        self.verdict = self._counts.verdict(self._file_scale)
        return self.verdict

    def complete(self) -> None:
        """The map is complete: what the verdict compares now and then is compared once more."""
        self._counts.close()

    def close(self) -> None:
        """Save the map and the record for good. Raises DiskError where the disk does not take them."""
        if self._closed:
            return
        self._closed = True
        self.complete()
        try:
            self._write_all(rewrites=True)
        finally:
            os.close(self._lock)

    def _save(self, rewrites: bool) -> None:
        self._save_timer.done(self._result.frame.stamp_s if self._result else 0.0)
        self._saved_at, self._failure = perf_counter(), None
        try:
            self._write_all(rewrites)
        except EdgemapError as error:
            self._failure = error

    def _write_all(self, rewrites: bool = False) -> None:
        """The map first: it is what the run is for. rewrites: whether trajectory and sightings get all corrections so
        far. Raises DiskError."""
        if not self.folder.exists():  # it vanished; made again where what it lay in is still there
            lock = lock_folder(self.folder, IN_USE, parents=False)
            os.close(self._lock)
            self._lock, self._saved_grid = lock, (None, 1.0)
        record = self._document()
        self._save_map()
        self._trajectory.flush()
        self._sightings.flush()
        journal, scale = self._result and self._result.trajectory, self._file_scale
        if rewrites and journal is not None and (journal.revision != self._rewritten_at or scale != 1.0):
            rewrite(self._trajectory.path, self._sightings.path, journal, scale)
            self._rewritten_at = journal.revision
        record["lines_lost"] = self._trajectory.dropped + self._sightings.dropped
        write_atomically(self.folder / "run.json", json.dumps(record, indent=1, allow_nan=False) + "\n")
        self.document = record

    def _save_map(self) -> None:
        """The map, and its grid where that has changed. Raises DiskError."""
        grid = (self._result and self._result.grid, self._file_scale)
        saved = scaled_map(self._counts.objects, self.verdict.on(self._annotations), *grid)
        save_map(self.folder / "map.json", *saved, grid_saved=grid == self._saved_grid)
        self._saved_grid = grid

    @property
    def _file_scale(self) -> float:
        """Scale of all files over the live map's: they change together, at the end."""
        return self._result.scale if self._closed and self._result else 1.0

    def _document(self) -> dict[str, Any]:
        """run.json as it stands, with the verdict."""
        if (scale := self._file_scale) != 1.0:
            self._counts.mount_seen |= {"used_height_m": round(scale * self._camera.mount.height_m, 4)}
        record = self._counts.document(scale) | {
            "finished": self._closed,
            "frames": self._counts.frames,
            "seconds": round(perf_counter() - self._started, 3),
            "stages_ms": {name: percentiles(times_ms) for name, times_ms in self._stage_times.items()},
            "merged": self._result.merged if self._result else {},
            "faults": self._faults,
        }
        return record | {"verdict": self.judge().document()}
