"""Trajectories that runs have written."""

from pathlib import Path

from edgemap.runtime.frames.trajectory import Trajectory, parse_tum


def read_tum(path: Path) -> Trajectory:
    return parse_tum(Path(path).read_bytes(), str(path))
