"""Poses over time, recorded or growing, planar or with attitudes, and the TUM text format."""

import math
from bisect import bisect_left, bisect_right
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from edgemap.geometry.arrays import Array
from edgemap.geometry.camera.attitude import Attitude
from edgemap.geometry.errors import EdgemapError
from edgemap.geometry.se2 import SE2
from edgemap.runtime.frames.errors import OdometryError
from edgemap.runtime.frames.faults import note_dropped
from edgemap.runtime.frames.reading import read_bytes
from edgemap.runtime.frames.tables import STAMP, NumberTable, columns

TUM = NumberTable((STAMP, *columns("x_m y_m z_m qx qy qz qw")), samples=True)
FASTEST_M_S = 60.0  # a car of KITTI; a faster pose was reset or is damaged
EDGE_S = 0.15  # by which poses may end before the pictures
QUATERNION_TOLERANCE = 0.02  # of its length: files keep few digits


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

    def at(self, stamp_s: float, tolerance_s: float = EDGE_S) -> SE2:
        """The pose at a stamp, interpolated. Raises OdometryError for a stamp outside by more than the tolerance."""
        first, last = self.stamps_s[0], self.stamps_s[-1]
        if not first - tolerance_s <= stamp_s <= last + tolerance_s:
            raise OdometryError(f"no pose at {stamp_s:.3f} s: the trajectory covers {first:.3f} to {last:.3f} s")
        return _interpolated(self.stamps_s, self.poses, stamp_s)

    def from_start(self) -> "Trajectory":
        """The same trajectory relative to its first pose, which becomes the identity."""
        origin = self.poses[0].inverse()
        return Trajectory(self.stamps_s, tuple(origin @ pose for pose in self.poses))


def _interpolated(stamps_s: Sequence[float] | Array, poses: Sequence[SE2], stamp_s: float) -> SE2:
    """The pose at a stamp; the first one before all stamps, the last one after them."""
    after = bisect_left(stamps_s, stamp_s)
    if after in (0, len(poses)):
        return poses[min(after, len(poses) - 1)]
    share = (stamp_s - stamps_s[after - 1]) / (stamps_s[after] - stamps_s[after - 1])
    return poses[after - 1].interpolate(poses[after], share)


def tum_rows(data: bytes, path: str, error: type[EdgemapError], table: NumberTable = TUM) -> NDArray[np.float64]:
    """The numbers of TUM text, (N, 8), `stamp x y z qx qy qz qw` per line, quaternions scaled to length 1; lines that
    are no samples are dropped and counted. Raises `error` where half of them are none."""
    numbers, rows = table.parse(data, path, error)
    norms = np.linalg.norm(rows[:, 4:], axis=1)
    unit = np.abs(norms - 1.0) <= QUATERNION_TOLERANCE
    wrong = [f"{numbers[at]}: quaternion has length {norms[at]:.3f}, must be 1" for at in np.flatnonzero(~unit)]
    if 2 * len(wrong) >= len(rows):
        raise error(f"{path}:{wrong[0]} ({len(wrong)} of {len(rows)} lines are no poses)")
    note_dropped(path, [f"line {why}" for why in wrong], len(rows))
    rows[:, 4:] /= np.where(unit, norms, 1.0)[:, None]
    return rows[unit]


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
    data = read_bytes(path, OdometryError)
    whole = data[: data.rfind(b"\n") + 1]  # a power cut may leave a torn last line
    if not whole.strip():
        return None
    rows = tum_rows(whole, str(path), OdometryError)
    qx, qy, qz, qw = rows[:, 4:].T
    yaws = np.arctan2(2.0 * (qw * qz + qx * qy), 1.0 - 2.0 * (qy * qy + qz * qz))
    return Trajectory(rows[:, 0], tuple(SE2(*pose) for pose in np.column_stack([rows[:, 1:3], yaws]).tolist()))


KEPT = 500  # poses, which are read again for every frame
AHEAD_S = 0.2  # beyond the newest pose, at the latest speed
SPEED_OVER_S = 0.02  # least interval between the two poses of a speed
JUMP_M = 0.5  # least length of a jump; a longer step is a jump where it is faster than wheels
SET_BACK_S = 1.0  # a pose that is older than the newest by less is only late


class GrowingTrack:
    """The newest poses by increasing stamps. It restarts where a robot's odometry restarts: at a pose that wheels
    cannot reach in that time, or after a clock was set back. restarts: how often."""

    def __init__(self) -> None:
        self._stamps: list[float] = []
        self._poses: list[SE2] = []
        self.restarts = self._raised = 0  # the latter: those that `at` has raised

    @property
    def stamps_s(self) -> NDArray[np.float64]:
        """Stamps of the stored poses."""
        return np.array(self._stamps)

    @property
    def poses(self) -> tuple[SE2, ...]:
        """The stored poses."""
        return tuple(self._poses)

    def push(self, stamp_s: float, pose: SE2) -> None:
        """Adds a pose; one that is not finite, or older than the last, is ignored."""
        if not math.isfinite(stamp_s) or not np.isfinite(pose.vector()).all():
            return
        if self._stamps:
            step_s, last = stamp_s - self._stamps[-1], self._poses[-1]
            if -SET_BACK_S < step_s <= 0.0:
                return
            jump_m = math.hypot(pose.x_m - last.x_m, pose.y_m - last.y_m)
            if step_s < 0.0 or jump_m > max(FASTEST_M_S * step_s, JUMP_M):
                self._stamps.clear()
                self._poses.clear()
                self.restarts += 1
        self._stamps.append(stamp_s)
        self._poses.append(pose)
        if len(self._stamps) > 2 * KEPT:
            del self._stamps[:-KEPT], self._poses[:-KEPT]

    def at(self, stamp_s: float, tolerance_s: float = 0.0) -> SE2:
        """The pose at a stamp, interpolated, or extrapolated up to `AHEAD_S` after the newest one. Raises OdometryError
        outside, and once after a restart. tolerance_s: allowed time before the oldest pose."""
        if self._raised != self.restarts:
            self._raised = self.restarts
            raise OdometryError(f"poses began again at {self._stamps[0]:.3f} s")
        if not self._stamps:
            raise OdometryError("no pose has come yet")
        first, last = self._stamps[0], self._stamps[-1]
        if not first - tolerance_s <= stamp_s <= last + AHEAD_S:
            raise OdometryError(f"no pose at {stamp_s:.3f} s: those that came are from {first:.3f} to {last:.3f} s")
        if stamp_s <= last or len(self._stamps) == 1:
            return _interpolated(self._stamps, self._poses, stamp_s)
        before = max(bisect_right(self._stamps, last - SPEED_OVER_S) - 1, 0)
        step = self._poses[before].inverse() @ self._poses[-1]
        return self._poses[-1] @ SE2(*((stamp_s - last) / (last - self._stamps[before]) * step.vector()))


PoseTrack = Trajectory | GrowingTrack


SIGMA_RAD = math.radians(0.2)  # of a recorded pose: stamps of pictures and poses differ slightly


@dataclass(frozen=True, slots=True, eq=False)
class AttitudeTrack:
    """Roll and pitch of the camera as in `Mount`, (N,) each, and height of the lens above that at the first pose,
    metres (N,), at increasing stamps (N,) in seconds."""

    stamps_s: Array
    roll_rad: Array
    pitch_rad: Array
    risen_m: Array

    def at(self, stamp_s: float, height_m: float) -> Attitude:
        """The attitude at a stamp, interpolated; constant beyond both ends. height_m: of the lens at the first pose."""
        roll, pitch, risen = (
            float(np.interp(stamp_s, self.stamps_s, values)) for values in (self.roll_rad, self.pitch_rad, self.risen_m)
        )
        return Attitude(roll, pitch, np.eye(2) * SIGMA_RAD**2, height_m + risen, source="truth")
