"""An odometry on drives with true poses: what `edgemap eval odometry` and the paper's tables are made of."""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import degrees, inf
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from edgemap.evaluation.odometry import (
    INDOOR_LENGTHS_M,
    KITTI_LENGTHS_M,
    DriveErrors,
    availability,
    errors_of,
    figures,
    worst_drive,
)
from edgemap.evaluation.trajectory import attitude_figures, integrated, planar_fit
from edgemap.geometry.camera.attitude import Attitude
from edgemap.geometry.camera.floor import FloorCamera
from edgemap.geometry.camera.imu import ImuSamples
from edgemap.geometry.camera.mount import Mount
from edgemap.geometry.se2 import SE2
from edgemap.runtime.frames.camera import Camera, CameraOptions
from edgemap.runtime.frames.errors import OdometryError
from edgemap.runtime.inputs.cameras.pictures import drive_camera
from edgemap.runtime.inputs.drives import READERS, open_drive
from edgemap.runtime.inputs.open import open_camera
from edgemap.runtime.motion.attitude.estimator import open_attitude
from edgemap.runtime.motion.odometry import open_odometry
from edgemap.runtime.motion.rest import RestRule
from edgemap.runtime.network.bundle import Bundle
from edgemap.runtime.step.config import Config
from edgemap.runtime.step.frame_observations import FrameObservations
from edgemap.runtime.step.pipeline import Pipeline

NO_REST = RestRule(shifted_px=-inf)  # what an odometry says of a robot that stands is judged as well
OWN_WHEELS = "wheel"  # as an odometry: the wheels that come with the data


@dataclass(frozen=True, slots=True, eq=False)
class Followed:
    """N frames of a drive. indices: which of the camera's frames. true, estimated: N poses of the base in the frame of
    the first one. covariances: (N - 1, 3, 3) of the estimated motions. faults: motions that were guesses.
    attitudes: N, as given to the odometry. members: of each motion, as of `Motion.members`; an odometry that has none
    is its own."""

    indices: tuple[int, ...]
    stamps_s: NDArray[np.float64]
    true: tuple[SE2, ...]
    estimated: tuple[SE2, ...]
    covariances: NDArray[np.float64]
    faults: int
    attitudes: tuple[Attitude | None, ...] = ()
    members: tuple[Mapping[str, str], ...] = ()


def follow(
    camera: Camera,
    pipeline: Pipeline,
    *,
    first: int = 0,
    every: int = 1,
    frames: int | None = None,
    progress: Callable[[], object] = lambda: None,
) -> Followed:
    """Passes every `every`-th frame from `first` on, at most `frames`, through the front end, and integrates the
    motions. progress: called after each frame. Raises OdometryError where the camera brings no true poses or fewer than
    two frames.
    """
    if camera.info.truth is None:
        raise OdometryError(f"{camera.info.name} brings no true poses of its own to compare with")
    indices: list[int] = []
    true: list[SE2] = []
    observed: list[FrameObservations] = []
    skipped: list[ImuSamples] = []
    while (frames is None or len(indices) < frames) and (frame := camera.read()) is not None:
        skipped.append(frame.imu)
        if frame.index < first or (frame.index - first) % every:
            continue
        frame, skipped = replace(frame, imu=ImuSamples.joined(skipped), index=len(indices)), []
        observed.append(pipeline.step(frame))
        true.append(camera.info.truth.at(frame.stamp_s))
        indices.append(first + every * len(indices))
        progress()
    if len(indices) < 2:
        raise OdometryError(f"{camera.info.name}: {len(indices)} frames from frame {first} on, a motion needs two")
    start, motions = true[0].inverse(), [one.motion for one in observed[1:]]
    guessed = [motion.blind for motion in motions]
    name = pipeline.odometry.name
    return Followed(
        tuple(indices),
        np.array([one.stamp_s for one in observed]),
        tuple(start @ pose for pose in true),
        tuple(integrated([motion.motion for motion in motions])),
        np.array([motion.covariance for motion in motions]),
        sum(guessed),
        tuple(one.camera.attitude if one.camera else None for one in observed),
        tuple(m.members or {name: "blind" if b else "used"} for m, b in zip(motions, guessed, strict=True)),
    )


@dataclass(frozen=True, slots=True)
class Selection:
    """Frames and sensors of a drive that are evaluated: every `every`-th frame from `first` on, at most `frames`.

    lengths_m: of the segments; None for the kind's own. wheels, imu, depth: whether the data's own may be used. mount:
    replaces the data's height and pitch, for the odometry and not for the truth. config: the step's tuned numbers.
    """

    first: int = 0
    every: int = 1
    frames: int | None = None
    lengths_m: tuple[float, ...] | None = None
    wheels: bool = True
    imu: bool = True
    depth: bool = True
    mount: Mount | None = None
    config: Config = field(default_factory=Config)


@dataclass(frozen=True, slots=True, eq=False)
class ScoredDrive:
    """One drive, followed and compared with its truth. planar_fit: as of `evaluation.planar_fit`, None for data whose
    poses are planar already. attitude: as of `evaluation.attitude`."""

    spec: str
    mount: Mount
    followed: Followed
    errors: DriveErrors
    planar_fit: dict[str, float | None] | None
    attitude: dict[str, Any]

    def document(self) -> dict[str, Any]:
        """All figures and facts of the drive."""
        rate_hz = 1.0 / float(np.median(np.diff(self.followed.stamps_s)))
        mount = {"height_m": self.mount.height_m, "pitch_deg": round(degrees(self.mount.pitch_rad), 3)}
        facts = {"data": self.spec, "rate_hz": round(rate_hz, 3), "mount": mount, "faults": self.followed.faults}
        fit = {} if self.planar_fit is None else {"planar_fit": self.planar_fit}
        shares = availability(self.followed.members)
        return {**facts, **figures([self.errors]), **fit, "attitude": self.attitude, "availability": shares}


def score_drive(
    spec: str, odometry: str, bundle: Bundle, selection: Selection, progress: Callable[[], object] = lambda: None
) -> ScoredDrive:
    """Follow `KIND:DIR`, a recording, or `demo`, with the odometry of that SPEC.

    Raises CameraError for data, OdometryError for an odometry that is not available, or data without truth or mount.
    """
    camera, full = _open(spec, selection.depth)
    with camera:
        if camera.info.truth is None:
            raise OdometryError(f"{spec} brings no true poses of its own to compare with")
        mount = camera.info.mount or selection.mount
        if camera.info.intrinsics is None or mount is None:
            missing = "lens" if camera.info.intrinsics is None else "mount"
            raise OdometryError(f"{spec}: {missing} unknown: write it into its camera.yaml, or give --mount")
        if selection.mount is not None:
            mount = replace(mount, height_m=selection.mount.height_m, pitch_rad=selection.mount.pitch_rad)
        if odometry == OWN_WHEELS and (camera.info.wheel is None or not selection.wheels):
            raise OdometryError(f"{spec}: no wheel odometry comes with it")
        floor, tuned = FloorCamera(camera.info.intrinsics, mount), selection.config
        rules = tuned.odometry, tuned.health, tuned.attitude.check.tilt
        motion = open_odometry(odometry, bundle, camera, floor, selection.wheels, *rules)
        attitude = open_attitude(odometry, camera, floor, selection.imu, tuned.attitude, tuned.health, tuned.odometry)
        step = Pipeline(bundle, floor, motion, config=replace(tuned, rest=NO_REST), attitude=attitude)
        followed = follow(
            camera, step, first=selection.first, every=selection.every, frames=selection.frames, progress=progress
        )
        lengths = selection.lengths_m or (KITTI_LENGTHS_M if spec.startswith("kitti:") else INDOOR_LENGTHS_M)
        known = camera.info.attitudes
        level = None if known is None else [known.at(stamp_s, mount.height_m) for stamp_s in followed.stamps_s]
        attitudes = attitude_figures(followed.attitudes, level)
        errors = errors_of(followed.true, followed.estimated, followed.covariances, lengths, followed.stamps_s)
        fit = None if full is None else planar_fit(full[list(followed.indices)], lengths)
        return ScoredDrive(spec, mount, followed, errors, fit, attitudes)


def together(drives: dict[str, ScoredDrive]) -> dict[str, Any]:
    """The document of `edgemap eval odometry`: figures of each sequence by name, and of all sequences pooled."""
    errors = {name: drive.errors for name, drive in drives.items()}
    total = {"sequences": len(drives), **figures(list(errors.values())), "worst": worst_drive(errors)}
    total["faults"] = sum(drive.followed.faults for drive in drives.values())
    total["availability"] = availability([step for drive in drives.values() for step in drive.followed.members])
    return {"sequences": {name: drive.document() for name, drive in drives.items()}, "total": total}


def sequence_names(specs: Sequence[str]) -> list[str]:
    """A short name of each: the folder's or file's own, the whole SPEC where two would be the same."""
    short = [spec if spec.startswith("sim:") else Path(spec.partition(":")[2] or spec).name or spec for spec in specs]
    times = Counter(short)
    return [name if times[name] == 1 else spec for name, spec in zip(short, specs, strict=True)]


def _open(spec: str, depth: bool) -> tuple[Camera, NDArray[np.float64] | None]:
    if spec.partition(":")[0] not in READERS:
        return open_camera(spec, CameraOptions(depth=depth)), None
    drive = open_drive(spec)
    return drive_camera(drive if depth else replace(drive, depth=()), spec), drive.full_poses
