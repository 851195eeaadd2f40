"""Poses of another program in a file: their axes, units and order, and the poses of the base."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from edgemap.geometry.arrays import Array
from edgemap.geometry.camera.attitude import Attitude
from edgemap.geometry.camera.mount import Mount
from edgemap.geometry.se2 import SE2
from edgemap.runtime.frames.errors import CameraError, OdometryError
from edgemap.runtime.frames.reading import read_bytes
from edgemap.runtime.frames.spatial_poses import attitudes_of, planarise, pose_of, poses_of
from edgemap.runtime.frames.tables import Column, NumberTable
from edgemap.runtime.frames.trajectory import EDGE_S, FASTEST_M_S, TUM, AttitudeTrack, PoseTrack, Trajectory, tum_rows

# ORB-SLAM3 writes nanoseconds.
TUM_OF_OTHERS = NumberTable((Column("stamp", -1e19, 1e19), *TUM.columns[1:]), samples=True)
BASE, CAMERA = "base", "camera"
CLEARLY = 0.2  # by which a rarer reading must explain the file better (eight drives: 0.27 to 1, a right one 0.05)
UPRIGHT = math.cos(math.radians(10.0))  # of an axis of the world to up: it is meant to be up
UNITS = {"s": 1.0, "ms": 1e3, "us": 1e6, "ns": 1e9}
PERIODS_S = 0.001, 2.0  # between two poses of a trajectory; other medians are stamps in another unit


@dataclass(frozen=True, slots=True, eq=False)
class GivenPoses:
    """The base's planar poses; the camera's attitude at them, None where the poses are planar. height_m: of the lens at
    the first pose. read_as: how the file was read, where that is not as usual. start: where the map begins."""

    trajectory: PoseTrack
    attitudes: AttitudeTrack | None
    height_m: float
    read_as: tuple[str, ...] = ()
    start: SE2 | None = None

    def attitude(self, stamp_s: float) -> Attitude | None:
        """The camera's attitude; None where the poses are planar, or do not reach."""
        track = self.attitudes
        if track is None or not track.stamps_s[0] - EDGE_S <= stamp_s <= track.stamps_s[-1] + EDGE_S:
            return None
        return track.at(stamp_s, self.height_m)

    def correction(self, stamp_s: float) -> Callable[[float], SE2 | None] | None:  # noqa: ARG002
        """Called at each frame: all poses so far in the map, by stamp, where a live source has corrected them."""
        return None

    def by_clock(self, name: str, from_s: float, to_s: float) -> "GivenPoses":
        """These poses with stamps in seconds: of the unit, seconds if possible, in which they overlap the pictures'
        span and follow each other soon. Raises OdometryError, with both spans, where there is none."""
        stamps = self.trajectory.stamps_s
        period = _period(stamps)
        fits = [
            unit for unit, per_s in UNITS.items()
            if stamps[0] / per_s <= to_s + EDGE_S and stamps[-1] / per_s >= from_s - EDGE_S
            and (unit == "s" or PERIODS_S[0] <= period / per_s <= PERIODS_S[1])
        ]  # fmt: skip
        if not fits:
            spans = f"its poses are of {stamps[0]:.3f} to {stamps[-1]:.3f} s, the pictures from {from_s:.3f}"
            ends = f" to {to_s:.3f} s" if math.isfinite(to_s) else " s on"
            raise OdometryError(f"{name}: {spans}{ends}: they do not overlap (two clocks?)")
        unit = _unit_of(period, fits)
        if unit == "s":
            return self
        seconds = stamps / UNITS[unit]
        attitudes = self.attitudes and replace(self.attitudes, stamps_s=seconds)
        read_as = (f"its stamps are in {unit}", *self.read_as)
        return replace(
            self, trajectory=Trajectory(seconds, self.trajectory.poses), attitudes=attitudes, read_as=read_as
        )


@dataclass(frozen=True, slots=True, eq=False)
class _Reading:
    """One way to read the rows. up: of the world. score: how well the robot's motion explains them, 0 to 1."""

    frame: str
    w_first: bool
    poses: Array
    up: Array
    score: float


def read_given(path: Path, mount: Mount, frame: str | None = None) -> GivenPoses:
    """Reads FILE.tum; its stamps are the file's until `by_clock`, lengths too fast for metres are in millimetres.

    frame: base or camera, whose poses they are; None: by the motion. Raises OdometryError with the line number, or
    where stamps do not increase.
    """
    rows = tum_rows(read_bytes(path, OdometryError), str(path), OdometryError, TUM_OF_OTHERS)
    if millimetres := _too_fast(rows):
        rows[:, 1:4] /= 1000.0
    frames = [frame] if frame else [BASE, CAMERA]
    readings = [_read(rows, mount, one, w_first) for w_first in (False, True) for one in frames]
    enough = max(one.score for one in readings) - CLEARLY
    best = next(one for one in readings if one.score >= enough)
    read_as = ["its lengths are in millimetres"] if millimetres else []
    read_as += ["its quaternions have w first"] if best.w_first else []
    read_as += ["it holds poses of the camera's optical axes"] if best.frame not in frames[:1] else []
    try:
        planar, attitudes = _of_base(best, rows[:, 0], mount)
        return GivenPoses(Trajectory(rows[:, 0], planar), attitudes, mount.height_m, tuple(read_as))
    except (OdometryError, CameraError) as error:
        raise OdometryError(f"{path}: {error}") from None


def _period(stamps: Array) -> float:
    """The median time between two poses, in the stamps' unit; 0 for a single pose."""
    return float(np.median(np.diff(stamps))) if len(stamps) > 1 else 0.0


def _unit_of(period: float, units: Sequence[str]) -> str:
    """The first of some units of stamps in which poses follow each other soon; else the first one."""
    return next((unit for unit in units if period / UNITS[unit] <= PERIODS_S[1]), units[0])


def _too_fast(rows: Array) -> bool:
    """Whether poses in metres would move faster than any camera of ours."""
    span_s = (rows[-1, 0] - rows[0, 0]) / UNITS[_unit_of(_period(rows[:, 0]), list(UNITS))]
    path = float(np.linalg.norm(np.diff(rows[:, 1:4], axis=0), axis=1).sum())
    return span_s > 0.0 and path > FASTEST_M_S * span_s


def _of_base(read: _Reading, stamps_s: Array, mount: Mount) -> tuple[tuple[SE2, ...], AttitudeTrack | None]:
    """Planar poses of the base, and the camera's attitudes where the poses are not planar. Poses in base axes are those
    of the base or of the lens above it, whichever leaves the lens at a more constant height."""
    lens = [read.poses]
    if read.frame == BASE:
        planar = planarise(read.poses, read.up, "x")
        if attitudes_of(stamps_s, read.poses, read.up, mount) is None:
            return planar, None
        to_base = mount.rotation_base_optical()
        lens = [read.poses @ pose_of(to_base, arm_m) for arm_m in (mount.position_base_m(), np.zeros(3))]
    poses = min(lens, key=lambda some: float(np.std(some[:, :3, 3] @ read.up)))
    return planarise(poses, read.up, "z", mount), attitudes_of(stamps_s, poses, read.up)


def _read(rows: Array, mount: Mount, frame: str, w_first: bool) -> _Reading:
    """A reading with its score: the mean of the shares of rotation about the body's up and of motion ahead that this
    frame has on a robot or a person, and of how constant the world's up is."""
    to_body = mount.rotation_base_optical().T if frame == CAMERA else np.eye(3)
    ahead, up = to_body[:, 0], to_body[:, 2]
    poses = poses_of(rows[:, 1:4], rows[:, [5, 6, 7, 4]] if w_first else rows[:, 4:])
    rotations = poses[:, :3, :3]
    world_up = (rotations @ up).mean(axis=0)
    constant = float(np.linalg.norm(world_up))
    world_up = world_up / max(constant, 1e-9)
    back = rotations[:-1].transpose(0, 2, 1)
    turns = Rotation.from_matrix(back @ rotations[1:]).as_rotvec() if len(back) else np.zeros((0, 3))
    moves = (back @ np.diff(poses[:, :3, 3], axis=0)[:, :, None])[:, :, 0]
    about, along = turns @ up, moves @ ahead
    turning = float(about @ about) / max(float(np.square(turns).sum()), 1e-12)
    going = float(along @ np.abs(along)) / max(float(np.square(moves).sum()), 1e-12)
    axis = int(np.abs(world_up).argmax())
    if frame == BASE and world_up[2] < -UPRIGHT:
        constant = 0.0  # upside down
    if abs(world_up[axis]) > UPRIGHT and (frame == BASE or not np.allclose(rotations[0], np.eye(3), atol=1e-3)):
        world_up = np.sign(world_up[axis]) * np.eye(3)[axis]  # but for a world that is the first camera's
    return _Reading(frame, w_first, poses, world_up, (turning + going + constant) / 3.0)
