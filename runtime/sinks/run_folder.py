"""The run folder: map, trajectory, sightings and the run's own record, on disk from the first second on."""

from __future__ import annotations

import json
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from time import perf_counter
from typing import Any, TextIO

import cv2

from edgemap.geometry.camera.floor import FloorCamera
from edgemap.geometry.objects.map_object import MapObject, save_map, write_atomically
from edgemap.geometry.se2 import SE2
from edgemap.geometry.slam.keyframes import TrajectoryCorrection
from edgemap.runtime.errors import RunFolderError
from edgemap.runtime.loop_closing import LoopCorrection
from edgemap.runtime.overlay import draw_floor_grid
from edgemap.runtime.pipeline import StepResult
from edgemap.runtime.sinks.relocated_files import (
    corrected_sightings,
    corrected_trajectory,
    move_sightings,
    move_trajectory,
)
from edgemap.runtime.timing import percentiles
from edgemap.runtime.trajectory import tum_line

SAVE_EVERY = 20  # frames between two saved maps
MAX_FAULTS = 200  # in run.json; the count goes on


class RunFolder:
    """Writes `map.json`, `trajectory.tum`, `sightings.jsonl`, `run.json` and `mount.jpg` into a folder of its own.

    record: what run.json says of the run (configuration, sums, versions). An empty valid map exists at once. Where
    things seen again correct the way, trajectory and sightings are first written as known at the time, and anew at the
    end as known then.
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
        self._past: TrajectoryCorrection | None = None
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
        if result.corrected is not None:
            self._correct(result.corrected)
        if result.relocated is not None:
            self._relocate(result.relocated)
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
            self._settle_past()
        finally:
            with suppress(OSError):
                self._trajectory.close()
            with suppress(OSError):
                self._sightings.close()
            self._write_record(finished=True)

    def _relocate(self, pose_map_start: SE2) -> None:
        """Move what has been written so far into the saved map's frame."""
        self._settle_past()
        self._record = self._record | {
            "relocated": {"frame": self._frames, "pose_map_start": pose_map_start.vector().tolist()}
        }
        self._rewrite(
            lambda text: move_trajectory(text, pose_map_start), lambda text: move_sightings(text, pose_map_start)
        )

    def _correct(self, corrected: LoopCorrection) -> None:
        """Take note of how what has been written so far has moved."""
        self._past = corrected.past if self._past is None else self._past.then(corrected.past)
        before = self._record.get("corrections", {"count": 0, "largest_m": 0.0})
        self._record = self._record | {
            "corrections": {
                "count": before["count"] + 1,
                "largest_m": max(before["largest_m"], round(corrected.moved_m, 4)),
                "seen_again": corrected.links,
            }
        }

    def _settle_past(self) -> None:
        """Write trajectory and sightings anew as they are known now."""
        past, self._past = self._past, None
        if past is not None:
            self._rewrite(lambda text: corrected_trajectory(text, past), lambda text: corrected_sightings(text, past))

    def _rewrite(self, trajectory: Callable[[str], str], sightings: Callable[[str], str]) -> None:
        """Both files' text replaced, each atomically, and open again at its end."""
        self._trajectory.close()
        self._sightings.close()
        for name, change in (("trajectory.tum", trajectory), ("sightings.jsonl", sightings)):
            path = self.folder / name
            write_atomically(path, change(path.read_text()))
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
