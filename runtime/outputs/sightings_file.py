"""`sightings.jsonl` of a run folder: its lines, its reader, and how it and `trajectory.tum` are rewritten once loop
closures or relocalisation have moved the past, and at the final scale."""

import json
from collections.abc import Iterator
from io import BytesIO
from itertools import islice
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from edgemap.geometry.arrays import Array
from edgemap.geometry.errors import MapError
from edgemap.geometry.observations.sighting import PlacedSighting
from edgemap.geometry.se2 import SE2
from edgemap.geometry.trajectory_correction import composed
from edgemap.runtime.frames.disk import write_atomically
from edgemap.runtime.frames.errors import DiskError
from edgemap.runtime.frames.reading import Coordinate, Name, decode_json, read_bytes
from edgemap.runtime.frames.trajectory import tum_line
from edgemap.runtime.step.pose_journal import PoseJournal
from edgemap.runtime.step.slam import StepResult

LENGTHS = "distance_m", "width_m", "height_m"  # of a sighting, beside its position
BLOCK = 4096  # lines in memory at once: the files of a day are larger than a robot's memory


class SeenRecord(msgspec.Struct):
    """One sighting. object: id of its object, empty without one. map_m: x, y."""

    label: Name
    map_m: tuple[Coordinate, Coordinate]
    object: str = ""


class _Run(msgspec.Struct):
    merged: dict[str, str] = msgspec.field(default_factory=dict)


def sighting_record(result: StepResult, placed: PlacedSighting, identity: str) -> dict[str, Any]:
    """One sighting as a line holds it: its position in the picture, from the robot, and in the map."""
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
    } | {name: round(getattr(sighting, name), 4) for name in LENGTHS}


def read_sightings(folder: Path) -> list[SeenRecord]:
    """The observations of a run; an object that was merged into another has the other's id.

    Raises MapError with the line number for a damaged line; an incomplete last line (a power cut) is ignored.
    """
    path = folder / "sightings.jsonl"
    try:
        merged = decode_json(read_bytes(folder / "run.json", MapError), _Run, "run.json", MapError).merged
    except MapError:
        merged = {}
    records = []
    for number, line in enumerate(BytesIO(read_bytes(path, MapError)), start=1):
        if not line.endswith(b"\n"):
            break
        record = decode_json(line, SeenRecord, f"{path}:{number}: damaged line", MapError)
        record.object = merged.get(record.object, record.object)
        records.append(record)
    return records


def rewrite(trajectory: Path, sightings: Path, journal: PoseJournal, scale: float = 1.0) -> None:
    """Replace both files of a run, each atomically. The same journal leaves them as they are. scale: by which all
    lengths are multiplied; a sighting states it where it is not 1. Raises DiskError.
    """
    stamps_s, poses = _read(trajectory)
    poses = journal.moved_poses(stamps_s, poses)
    if not len(poses):
        return
    poses[:, :2] *= scale

    def tum_lines() -> Iterator[bytes]:
        for stamp_s, pose in zip(stamps_s, poses, strict=True):
            yield tum_line(stamp_s, SE2(*pose)).encode()

    def sighting_blocks() -> Iterator[bytes]:
        for lines in _blocks(sightings):
            records = [json.loads(line) for line in lines]
            if scale != 1.0:
                for record in records:
                    record["base_m"] = [round(scale * length_m, 4) for length_m in record["base_m"]]
                    record |= {name: round(scale * record[name], 4) for name in LENGTHS} | {"scale": scale}
            rows = np.searchsorted(stamps_s, [record["stamp_s"] for record in records], side="right") - 1
            base = np.array([[*record["base_m"], 0.0] for record in records])
            for record, (x_m, y_m, _) in zip(records, composed(poses[np.maximum(rows, 0)], base), strict=True):
                record["map_m"] = [round(float(x_m), 4), round(float(y_m), 4)]
            yield "".join(json.dumps(record) + "\n" for record in records).encode()

    write_atomically(trajectory, tum_lines)
    write_atomically(sightings, sighting_blocks)


def _read(trajectory: Path) -> tuple[Array, Array]:
    """Stamps (N,) and poses (N, 3) of a trajectory that a run has written."""
    rows = [np.zeros((0, 8))]
    rows += [np.array([line.split() for line in lines], dtype=np.float64) for lines in _blocks(trajectory)]
    stamp_s, x_m, y_m, *_, qz, qw = np.concatenate(rows).T
    return stamp_s, np.column_stack([x_m, y_m, 2.0 * np.arctan2(qz, qw)])


def _blocks(path: Path) -> Iterator[list[str]]:
    """The file's lines, some at a time."""
    try:
        with path.open() as file:
            while lines := list(islice(file, BLOCK)):
                yield lines
    except OSError as error:
        raise DiskError(f"{path}: cannot be read ({error.strerror})") from None
