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
from edgemap.geometry.observations.sighting import PlacedSighting
from edgemap.runtime.frames.disk import SAVE_EVERY_S, LineFile, lock_folder, write_atomically
from edgemap.runtime.frames.errors import DiskError, RunFolderError
from edgemap.runtime.frames.faults import Fault
from edgemap.runtime.frames.frame import jpeg
from edgemap.runtime.frames.timing import StreamTimer, percentiles
from edgemap.runtime.frames.trajectory import tum_line
from edgemap.runtime.outputs.sinks.rewriting import rewrite
from edgemap.runtime.outputs.verdict.run_counts import RunCounts
from edgemap.runtime.outputs.verdict.verdict import Verdict
from edgemap.runtime.step.loop_closing import LoopCorrection
from edgemap.runtime.step.map_file import save_map
from edgemap.runtime.step.overlay import draw_floor_grid
from edgemap.runtime.step.pose_journal import PoseJournal
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
        self._objects: list[MapObject] = []
        self._annotations = NO_ANNOTATIONS
        self._grid: OccupancyGrid | None = None
        self._saved_grid: tuple[OccupancyGrid | None, float] = (None, 1.0)  # and its scale
        self._scale = 1.0  # see `MapUpdate`
        self._merged: dict[str, str] = {}
        self._stage_times: dict[str, deque[float]] = {}  # of the latest 1,000 frames
        self._faults: list[dict[str, Any]] = []
        self.verdict = Verdict("care")  # of the newest save
        self.document: dict[str, Any] = {}  # run.json of the newest save
        self._journal: PoseJournal | None = None
        self._rewritten_at = 0  # revision of the journal that the files show
        self._frames = 0
        self._save_timer = StreamTimer(SAVE_EVERY_S)
        self._failure: EdgemapError | None = None  # of the newest save
        self._stamp_s = 0.0
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
        if self._frames == 0:
            picture = draw_floor_grid(result.frame.image, self._camera)
            with suppress(cv2.error, DiskError):
                write_atomically(self.folder / "mount.jpg", jpeg(picture))
        self._frames += 1
        self._stamp_s = stamp_s = result.frame.stamp_s
        self._trajectory.append(tum_line(stamp_s, result.pose_map_base))
        self.last(result, objects)
        for stage, time_ms in result.stages_ms.items():
            self._stage_times.setdefault(stage, deque(maxlen=1000)).append(time_ms)
        self._counts.write(result, objects)
        if result.relocated is not None or self._save_timer.is_due(stamp_s):
            self._save(rewrite=result.relocated is not None)
        if self._failure is not None:
            raise self._failure

    def last(self, result: StepResult, objects: list[MapObject]) -> None:
        """The map of a result and its sightings, without a step."""
        self._objects, self._merged, self._annotations = objects, result.merged, result.annotations
        self._journal, self._grid, self._scale = result.trajectory, result.grid, result.scale
        self._counts.edited(objects)
        if result.correction is not None:
            self._note_correction(result.correction)
        if result.relocated is not None:
            start = result.relocated.vector().tolist()
            self.add_record({"relocated": {"frame": self._frames, "pose_map_start": start}})
        for placed, identity in zip(result.sightings, result.object_ids, strict=True):
            record = sighting_record(result, placed, identity)
            self._sightings.append(json.dumps(record, allow_nan=False) + "\n")

    def fault(self, fault: Fault) -> None:
        """Records a fault with its frame; while a camera is disconnected, its faults trigger the saving."""
        self._counts.fault(fault)
        if len(self._faults) < MAX_FAULTS:
            self._faults.append(replace(fault, frame=self._frames).document())
        if perf_counter() - self._saved_at > SAVE_EVERY_S and not self._closed:
            self._save(rewrite=False)

    def edited(self, objects: list[MapObject], annotations: Annotations) -> None:
        """The map as a person has just edited it, saved at once; also after the run. Raises DiskError."""
        self._objects, self._annotations = objects, annotations
        self._counts.edited(objects)
        self._save_map()

    def judge(self) -> Verdict:
        """The verdict on the map as it stands, newer than that of the newest save."""
        self.verdict = self._counts.verdict(self._file_scale)
        return self.verdict

    def close(self) -> None:
        """Save the map and the record for good. Raises DiskError where the disk does not take them."""
        if self._closed:
            return
        self._closed = True
        try:
            self._write_all(rewrite=True)
        finally:
            os.close(self._lock)

    def _save(self, rewrite: bool) -> None:
        self._save_timer.done(self._stamp_s)
        self._saved_at, self._failure = perf_counter(), None
        try:
            self._write_all(rewrite)
        except EdgemapError as error:
            self._failure = error

    def _write_all(self, rewrite: bool = False) -> None:
        """The map first: it is what the run is for. Raises DiskError."""
        if not self.folder.exists():  # it vanished; made again where what it lay in is still there
            lock = lock_folder(self.folder, IN_USE, parents=False)
            os.close(self._lock)
            self._lock, self._saved_grid = lock, (None, 1.0)
        record = self._document()
        self._save_map()
        self._trajectory.flush()
        self._sightings.flush()
        if rewrite:
            self._rewrite()
        record["lines_lost"] = self._trajectory.dropped + self._sightings.dropped
        write_atomically(self.folder / "run.json", json.dumps(record, indent=1, allow_nan=False) + "\n")
        self.document = record

    def _save_map(self) -> None:
        """The map, and its grid where that has changed. Raises DiskError."""
        grid = (self._grid, self._file_scale)
        saved = scaled_map(self._objects, self.verdict.on(self._annotations), *grid)
        save_map(self.folder / "map.json", *saved, grid_saved=grid == self._saved_grid)
        self._saved_grid = grid

    @property
    def _file_scale(self) -> float:
        """Scale of all files over the live map's: they change together, at the end."""
        return self._scale if self._closed else 1.0

    def _note_correction(self, correction: LoopCorrection) -> None:
        """Count a loop closure in run.json."""
        before = self._counts.record.get("corrections", {"count": 0, "largest_m": 0.0})
        corrections = {
            "count": before["count"] + 1,
            "largest_m": max(before["largest_m"], round(correction.moved_m, 4)),
            "seen_again": correction.links,
        }
        self.add_record({"corrections": corrections})

    def _rewrite(self) -> None:
        """Rewrite trajectory and sightings with all corrections so far. Raises DiskError."""
        journal, scale = self._journal, self._file_scale
        if journal is None or (journal.revision == self._rewritten_at and scale == 1.0):
            return
        rewrite(self._trajectory.path, self._sightings.path, journal, scale)
        self._rewritten_at = journal.revision

    def _document(self) -> dict[str, Any]:
        """run.json as it stands, with the verdict."""
        if (scale := self._file_scale) != 1.0:
            self._counts.mount_seen |= {"used_height_m": round(scale * self._camera.mount.height_m, 4)}
        record = self._counts.document(scale) | {
            "finished": self._closed,
            "frames": self._frames,
            "seconds": round(perf_counter() - self._started, 3),
            "stages_ms": {name: percentiles(times_ms) for name, times_ms in self._stage_times.items()},
            "merged": self._merged,
            "faults": self._faults,
        }
        self.verdict = self._counts.verdict(scale)
        return record | {"verdict": self.verdict.document()}


def sighting_record(result: StepResult, placed: PlacedSighting, identity: str) -> dict[str, Any]:
    """One sighting as a line of sightings.jsonl: its position in the picture, from the robot, and in the map."""
    sighting = placed.sighting
    return {
        "frame": sighting.frame,
        "stamp_s": round(sighting.stamp_s, 6),
        "label": sighting.label,
        "score": round(sighting.score, 4),
        "box_px": [round(float(v), 1) for v in result.detections.boxes[sighting.detection]],
        "object": identity,
        "base_m": [round(float(v), 4) for v in sighting.position_base_m],
        "map_m": [round(float(v), 4) for v in placed.position_map_m],
        "distance_m": round(sighting.distance_m, 4),
        "width_m": round(sighting.width_m, 4),
        "height_m": round(sighting.height_m, 4),
    }
