"""The robot's trajectory beside a map, where a run has left one."""

from pathlib import Path

from edgemap.runtime.errors import OdometryError
from edgemap.runtime.number_rows import TABLE_BYTES
from edgemap.runtime.reading import read_bytes
from edgemap.runtime.trajectory import Trajectory, parse_tum


def trajectory_of(path: Path) -> Trajectory | None:
    """The complete lines of `trajectory.tum` in a map's folder; None where there is none, or not one pose in it.

    Raises OdometryError where it is damaged.
    """
    path = (path if path.is_dir() else path.parent) / "trajectory.tum"
    if not path.is_file():
        return None
    data = read_bytes(path, TABLE_BYTES, OdometryError)
    whole = data[: data.rfind(b"\n") + 1]  # a power cut may leave a torn last line
    return parse_tum(whole, str(path)) if whole.strip() else None
