"""The run folder: map, trajectory, sightings and the run's own record, on disk from the first second on."""

from __future__ import annotations

import json
from collections import deque
from contextlib import suppress
from pathlib import Path
from time import perf_counter
from typing import Any, TextIO

import cv2

from edgemap.geometry.camera.floor import FloorCamera
from edgemap.geometry.objects.map_object import MapObject
from edgemap.geometry.se2 import SE2
from edgemap.runtime.errors import RunFolderError
from edgemap.runtime.loop_closing import LoopCorrection
from edgemap.runtime.map_file import save_map, write_atomically
from edgemap.runtime.overlay import draw_floor_grid
from edgemap.runtime.pose_journal import PoseJournal
from edgemap.runtime.slam import StepResult
from edgemap.runtime.timing import percentiles
from edgemap.runtime.trajectory import tum_line

SAVE_EVERY = 20  # frames between two saved maps
MAX_FAULTS = 200  # in run.json; the count goes on


class RunFolder:
    """Writes `map.json`, `trajectory.tum`, `sightings.jsonl`, `run.json` and `mount.jpg` into a folder of its own.

    record: what run.json says of the run (configuration, sums, versions). An empty valid map exists at once. Trajectory
    and sightings are first written as known at the time; where loop closure or relocalisation moved the past, they are
    written again at the end, as known then.
    Raises RunFolderError where the folder cannot be made or holds another run already.
    """

    def __init__(self, folder: Path, camera: FloorCamera, record: dict[str, Any]) -> None:
        if (folder / "run.json").exists():
            raise RunFolderError(f"{folder} already holds a run; choose another --out")
        try:
            folder.mkdir(parents=True, exist_ok=True)
            save_map(folder / "map.json", [])
            self._trajectory = (folder / "trajectory.tum").open("w")
            self._sightings = (folder / "sightings.jsonl").open("w")
        except OSError as error:
            raise RunFolderError(f"{folder}: cannot be written ({error.strerror})") from None
        self.folder = folder
        self._camera, self._record = camera, record
        self._objects: list[MapObject] = []
        self._merged: dict[str, str] = {}
        self._laps: dict[str, deque[float]] = {}
        self._faults: list[str] = []
        self._journal: PoseJournal | None = None
        self._rewritten_at = 0  # revision of the journal that the files show
        self._fault_count = self._frames = 0
        self._started = perf_counter()
        self._closed = False
        self._write_record(finished=False)

    def write(self, result: StepResult, objects: list[MapObject]) -> None:
        """Append pose and sightings; save the map every `SAVE_EVERY` frames."""
        if self._frames == 0:
            picture = draw_floor_grid(result.frame.image, self._camera)
            cv2.imwrite(str(self.folder / "mount.jpg"), picture)
        self._frames += 1
        self._objects, self._merged = objects, result.merged
        self._journal = result.trajectory
        if result.correction is not None:
            self._note_correction(result.correction)
        if result.relocated is not None:
            start = result.relocated.vector().tolist()
            self._record = self._record | {"relocated": {"frame": self._frames, "pose_map_start": start}}
            self._rewrite()
        self._append(self._trajectory, tum_line(result.frame.stamp_s, result.pose_map_base))
        for placed, identity in zip(result.sightings, result.object_ids, strict=True):
            record = sighting_record(result, placed.sighting.detection, placed, identity)
            self._append(self._sightings, json.dumps(record, allow_nan=False) + "\n")
        for stage, lap_ms in result.stages_ms.items():
            self._laps.setdefault(stage, deque(maxlen=10_000)).append(lap_ms)
        if result.motion.fault:
            self.fault(result.motion.fault)
        if self._frames % SAVE_EVERY == 0:
            self._save()

    def fault(self, text: str) -> None:
        """Note a fault with the frame it came at."""
        self._fault_count += 1
        if len(self._faults) < MAX_FAULTS:
            self._faults.append(f"frame {self._frames}: {text}")

    def close(self) -> None:
        """Save the map and the record for good. Raises MapError or RunFolderError where the disk does not take them."""
        if self._closed:
            return
        self._closed = True
        try:
            self._save()
            self._rewrite()
        finally:
            with suppress(OSError):
                self._trajectory.close()
            with suppress(OSError):
                self._sightings.close()
            self._write_record(finished=True)

    def _note_correction(self, correction: LoopCorrection) -> None:
        """Count a loop closure in run.json."""
        before = self._record.get("corrections", {"count": 0, "largest_m": 0.0})
        self._record = self._record | {
            "corrections": {
                "count": before["count"] + 1,
                "largest_m": max(before["largest_m"], round(correction.moved_m, 4)),
                "seen_again": correction.links,
            }
        }

    def _rewrite(self) -> None:
        """Trajectory and sightings as known now, each replaced atomically and open again at its end."""
        journal = self._journal
        if journal is None or journal.revision == self._rewritten_at:
            return
        self._rewritten_at = journal.revision
        self._trajectory.close()
        self._sightings.close()
        for name, change in (("trajectory.tum", trajectory_now), ("sightings.jsonl", sightings_now)):
            path = self.folder / name
            write_atomically(path, change(path.read_text(), journal))
        self._trajectory = (self.folder / "trajectory.tum").open("a")
        self._sightings = (self.folder / "sightings.jsonl").open("a")

    def _append(self, stream: TextIO, text: str) -> None:
        try:
            stream.write(text)
        except OSError as error:
            raise RunFolderError(f"{stream.name}: cannot be written ({error.strerror})") from None

    def _save(self) -> None:
        """The map first: it is what the run is for."""
        save_map(self.folder / "map.json", self._objects)
        for stream in (self._trajectory, self._sightings):
            try:
                stream.flush()
            except OSError as error:
                raise RunFolderError(f"{stream.name}: cannot be written ({error.strerror})") from None
        if not self._closed:
            self._write_record(finished=False)

    def _write_record(self, finished: bool) -> None:
        seconds = perf_counter() - self._started
        stages = {name: percentiles(list(laps)) for name, laps in self._laps.items()}
        record = self._record | {
            "finished": finished,
            "frames": self._frames,
            "seconds": round(seconds, 3),
            "stages_ms": stages,
            "merged": self._merged,
            "fault_count": self._fault_count,
            "faults": self._faults,
        }
        write_atomically(self.folder / "run.json", json.dumps(record, indent=1, allow_nan=False) + "\n")


def sighting_record(result: StepResult, detection: int, placed: Any, identity: str) -> dict[str, Any]:
    """One sighting as a line of sightings.jsonl: where it was seen in the picture, from the robot, and on the map."""
    sighting = placed.sighting
    box = result.detections.boxes[detection]
    return {
        "frame": sighting.frame,
        "stamp_s": round(sighting.stamp_s, 6),
        "label": sighting.label,
        "score": round(sighting.score, 4),
        "box_px": [round(float(v), 1) for v in box],
        "object": identity,
        "base_m": [round(float(v), 4) for v in sighting.position_base_m],
        "map_m": [round(float(v), 4) for v in placed.position_map_m],
        "distance_m": round(sighting.distance_m, 4),
        "width_m": round(sighting.width_m, 4),
        "height_m": round(sighting.height_m, 4),
    }


def trajectory_now(text: str, journal: PoseJournal) -> str:
    """TUM text of poses as known at the time to the same stamps' poses as known now."""
    stamps_s = [float(line.split(maxsplit=1)[0]) for line in text.splitlines()]
    poses = journal.at(stamps_s) if stamps_s else ()
    return "".join(tum_line(stamp_s, SE2(*pose)) for stamp_s, pose in zip(stamps_s, poses, strict=True))


def sightings_now(text: str, journal: PoseJournal) -> str:
    """Lines of sightings.jsonl with `map_m` as known at the time to the same as known now."""
    records = [json.loads(line) for line in text.splitlines()]
    if not records:
        return text
    points = journal.points([record["stamp_s"] for record in records], [record["base_m"] for record in records])
    for record, point in zip(records, points.tolist(), strict=True):
        record["map_m"] = [round(value, 4) for value in point]
    return "".join(json.dumps(record) + "\n" for record in records)
