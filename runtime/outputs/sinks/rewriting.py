"""Rewrites a run folder's trajectory and sightings after loop closures and relocalisation, and at its final scale."""

import json
from collections.abc import Iterator
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from edgemap.geometry.arrays import Array
from edgemap.geometry.se2 import SE2
from edgemap.geometry.trajectory_correction import composed
from edgemap.runtime.frames.disk import write_atomically
from edgemap.runtime.frames.errors import DiskError
from edgemap.runtime.frames.trajectory import tum_line
from edgemap.runtime.step.pose_journal import PoseJournal

LENGTHS = "distance_m", "width_m", "height_m"  # of a sighting, beside its position
BLOCK = 4096  # lines in memory at once: the files of a day are larger than a robot's memory


def rewrite(trajectory: Path, sightings: Path, journal: PoseJournal, scale: float = 1.0) -> None:
    """Replace both files, each atomically. The same journal leaves them as they are. scale: by which all lengths are
    multiplied; a sighting states it where it is not 1. Raises DiskError.
    """
    stamps_s, poses = _read(trajectory)
    poses = journal.moved_poses(stamps_s, poses)
    if not len(poses):
        return
    poses[:, :2] *= scale

    def tum_blocks() -> Iterator[bytes]:
        for start in range(0, len(poses), BLOCK):
            rows = zip(stamps_s[start : start + BLOCK].tolist(), poses[start : start + BLOCK].tolist(), strict=True)
            yield "".join(tum_line(stamp_s, SE2(*pose)) for stamp_s, pose in rows).encode()

    def sighting_blocks() -> Iterator[bytes]:
        for lines in _blocks(sightings):
            records = [json.loads(line) for line in lines]
            stamps = [record["stamp_s"] for record in records]
            rows = np.searchsorted(stamps_s, stamps, side="right") - 1
            for record in records if scale != 1.0 else ():
                _rescale(record, scale)
            base = np.array([[*record["base_m"], 0.0] for record in records])
            for record, (x_m, y_m, _) in zip(records, composed(poses[np.maximum(rows, 0)], base), strict=True):
                record["map_m"] = [round(float(x_m), 4), round(float(y_m), 4)]
            yield "".join(json.dumps(record) + "\n" for record in records).encode()

    write_atomically(trajectory, tum_blocks)
    write_atomically(sightings, sighting_blocks)


def _rescale(record: dict[str, Any], scale: float) -> None:
    """Multiplies a sighting's lengths."""
    record["base_m"] = [round(scale * length_m, 4) for length_m in record["base_m"]]
    for name in LENGTHS:
        record[name] = round(scale * record[name], 4)
    record["scale"] = scale


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
