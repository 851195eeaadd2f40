"""A drive's poses over time, and the TUM text format they are kept in."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from edgemap.geometry.se2 import SE2
from edgemap.runtime.errors import OdometryError


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

    def from_start(self) -> Trajectory:
        """The same way seen from its first pose, which becomes the identity."""
        origin = self.poses[0].inverse()
        return Trajectory(self.stamps_s, tuple(origin @ pose for pose in self.poses))


def read_tum(path: Path) -> Trajectory:
    """Read planar poses from a TUM file. Raises OdometryError as `parse_tum` does."""
    try:
        text = path.read_text()
    except (OSError, UnicodeDecodeError) as error:
        raise OdometryError(f"{path}: cannot be read ({error})") from None
    return parse_tum(text, str(path))


def parse_tum(text: str, path: str) -> Trajectory:
    """Planar poses from TUM text: `stamp x y z qx qy qz qw` per line, z up, `#` starts a comment. path: for messages.

    Raises OdometryError with the line number for a line that is not eight finite numbers.
    """
    stamps, poses = [], []
    for number, line in enumerate(text.splitlines(), start=1):
        if not line.strip() or line.lstrip().startswith("#"):
            continue
        try:
            values = [float(word) for word in line.split()]
        except ValueError:
            values = []
        if len(values) != 8 or not all(map(math.isfinite, values)):
            raise OdometryError(f"{path}:{number}: need 8 numbers: stamp x y z qx qy qz qw, found {line.strip()!r}")
        stamp, x, y, _, qx, qy, qz, qw = values
        stamps.append(stamp)
        yaw = math.atan2(2.0 * (qw * qz + qx * qy), 1.0 - 2.0 * (qy * qy + qz * qz))
        poses.append(SE2(x, y, yaw))
    if not poses:
        raise OdometryError(f"{path}: no poses in it")
    try:
        return Trajectory(np.array(stamps), tuple(poses))
    except OdometryError as error:
        raise OdometryError(f"{path}: {error}") from None


def tum_line(stamp_s: float, pose: SE2) -> str:
    """One line of a TUM file, newline included."""
    half = pose.yaw_rad / 2.0
    return f"{stamp_s:.6f} {pose.x_m:.6f} {pose.y_m:.6f} 0 0 0 {math.sin(half):.9f} {math.cos(half):.9f}\n"
