"""A drive's poses over time, and the TUM text format they are kept in."""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from edgemap.geometry.errors import EdgemapError
from edgemap.geometry.se2 import SE2
from edgemap.runtime.frames.errors import OdometryError
from edgemap.runtime.frames.number_rows import STAMP, TABLE_BYTES, NumberTable, columns
from edgemap.runtime.frames.reading import read_bytes

TUM = NumberTable((STAMP, *columns("x_m y_m z_m qx qy qz qw")))
FASTEST_M_S = 60.0  # a car of KITTI's; a pose that jumps was set again, or is damaged
QUATERNION_TOLERANCE = 0.02  # of its length: files keep few digits


class PoseTrack(Protocol):
    """Poses over time that can be looked up: a Trajectory, or one that still grows."""

    @property
    def stamps_s(self) -> NDArray[np.float64]:
        """Stamps of the poses, s, strictly increasing."""
        ...

    @property
    def poses(self) -> tuple[SE2, ...]:
        """The poses, one per stamp."""
        ...

    def at(self, stamp_s: float, tolerance_s: float = ...) -> SE2:
        """The pose at a stamp. Raises OdometryError where there is none."""
        ...


@dataclass(frozen=True, slots=True)
class Trajectory:
    """Poses of the base, `pose_map_base`, at strictly increasing stamps in seconds."""

    stamps_s: NDArray[np.float64]
    poses: tuple[SE2, ...]

    def __post_init__(self) -> None:
        if len(self.stamps_s) != len(self.poses) or not self.poses:
            raise OdometryError(f"trajectory: {len(self.stamps_s)} stamps for {len(self.poses)} poses")
        if not np.all(np.isfinite(self.stamps_s)) or np.any(np.diff(self.stamps_s) <= 0):
            raise OdometryError("trajectory: stamps must be finite and strictly increasing")

    def at(self, stamp_s: float, tolerance_s: float = 0.15) -> SE2:
        """The pose at a stamp, interpolated. Raises OdometryError where it lies further than the tolerance outside."""
        first, last = self.stamps_s[0], self.stamps_s[-1]
        if not first - tolerance_s <= stamp_s <= last + tolerance_s:
            raise OdometryError(f"no pose at {stamp_s:.3f} s: the trajectory covers {first:.3f} to {last:.3f} s")
        after = int(np.searchsorted(self.stamps_s, stamp_s))
        if after == 0:
            return self.poses[0]
        if after == len(self.poses):
            return self.poses[-1]
        span = self.stamps_s[after] - self.stamps_s[after - 1]
        return self.poses[after - 1].interpolate(self.poses[after], (stamp_s - self.stamps_s[after - 1]) / span)

    def from_start(self) -> "Trajectory":
        """The same trajectory relative to its first pose, which becomes the identity."""
        origin = self.poses[0].inverse()
        return Trajectory(self.stamps_s, tuple(origin @ pose for pose in self.poses))


def read_tum(path: Path) -> Trajectory:
    """Read planar poses from a TUM file. Raises OdometryError as `parse_tum` does."""
    return parse_tum(read_bytes(path, TABLE_BYTES, OdometryError), str(path))


def parse_tum(data: bytes | str, path: str) -> Trajectory:
    """Planar poses from TUM text: `stamp x y z qx qy qz qw` per line, z up, `#` starts a comment. path: for messages.

    Raises OdometryError with the line number for a line that is not eight finite numbers with a unit quaternion.
    """
    rows = tum_rows(data.encode() if isinstance(data, str) else data, path, OdometryError)
    qx, qy, qz, qw = rows[:, 4:].T
    yaws = np.arctan2(2.0 * (qw * qz + qx * qy), 1.0 - 2.0 * (qy * qy + qz * qz))
    poses = tuple(SE2(*pose) for pose in np.column_stack([rows[:, 1:3], yaws]).tolist())
    try:
        return Trajectory(rows[:, 0], poses)
    except OdometryError as error:
        raise OdometryError(f"{path}: {error}") from None


def tum_rows(data: bytes, path: str, error: type[EdgemapError]) -> NDArray[np.float64]:
    """The numbers of TUM text, (N, 8), quaternions scaled to length 1. Raises `error` with the line number."""
    numbers, rows = TUM.parse(data, path, error)
    norms = np.linalg.norm(rows[:, 4:], axis=1)
    wrong = np.flatnonzero(np.abs(norms - 1.0) > QUATERNION_TOLERANCE)
    if len(wrong):
        raise error(f"{path}:{numbers[wrong[0]]}: quaternion has length {norms[wrong[0]]:.3f}, must be 1")
    rows[:, 4:] /= norms[:, None]
    return rows


def tum_line(stamp_s: float, pose: SE2) -> str:
    """One line of a TUM file, newline included."""
    half = pose.yaw_rad / 2.0
    return f"{stamp_s:.6f} {pose.x_m:.6f} {pose.y_m:.6f} 0 0 0 {math.sin(half):.9f} {math.cos(half):.9f}\n"


def trajectory_of(path: Path) -> Trajectory | None:
    """The complete lines of `trajectory.tum` in a map's folder; None where the file is missing or has no pose. Raises
    OdometryError where it is damaged.
    """
    path = (path if path.is_dir() else path.parent) / "trajectory.tum"
    if not path.is_file():
        return None
    data = read_bytes(path, TABLE_BYTES, OdometryError)
    whole = data[: data.rfind(b"\n") + 1]  # a power cut may leave a torn last line
    return parse_tum(whole, str(path)) if whole.strip() else None
