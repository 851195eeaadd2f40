"""An odometry on drives with true poses: what `edgemap eval odometry` and the paper's tables are made of."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from math import degrees, inf
from pathlib import Path
from typing import Any

import numpy as np

from edgemap.evaluation.odometry import (
    INDOOR_LENGTHS_M,
    KITTI_LENGTHS_M,
    DriveErrors,
    errors_of,
    figures,
    worst_drive,
)
from edgemap.evaluation.trajectory import attitude_figures, integrated, planar_fit
from edgemap.geometry.camera.floor import FloorCamera
from edgemap.geometry.camera.imu import ImuSamples
from edgemap.geometry.camera.mount import Mount
from edgemap.geometry.se2 import SE2
from edgemap.runtime.frames.camera import Camera, CameraOptions
from edgemap.runtime.frames.errors import OdometryError
from edgemap.runtime.frames.frame import Frame
from edgemap.runtime.frames.trajectory import AttitudeTrack
from edgemap.runtime.inputs.drives import READERS, open_drive
from edgemap.runtime.inputs.open import open_camera
from edgemap.runtime.motion.rest import RestRule
from edgemap.runtime.network.bundle import Bundle
from edgemap.runtime.step.config import Config
from edgemap.runtime.step.frame_observations import FrameObservations
from edgemap.runtime.step.slam import SlamOptions, build_slam

NO_REST = RestRule(shifted_px=-inf)  # what an odometry says of a robot that stands is judged as well
OWN_WHEELS = "wheel"  # as an odometry: the wheels that come with the data


@dataclass(frozen=True, slots=True)
class Selection:
    """Frames of a drive that are evaluated: every `every`-th frame from `first` on, at most `frames`.

    lengths_m: of the segments; None for the kind's own. depth: whether the data's own may be used. mount: replaces the
    data's height and pitch, for the odometry and not for the truth. config: the step's tuned numbers.
    """

    first: int = 0
    every: int = 1
    frames: int | None = None
    lengths_m: tuple[float, ...] | None = None
    depth: bool = True
    mount: Mount | None = None
    config: Config = field(default_factory=Config)


@dataclass(frozen=True, slots=True, eq=False)
class ScoredDrive:
    """One drive, followed and compared with its truth. true, estimated: poses of the base in the frame of the first
    one. document: all its figures and facts."""

    true: list[SE2]
    estimated: list[SE2]
    errors: DriveErrors
    document: dict[str, Any]


def score_drive(
    spec: str, how: SlamOptions, bundle: Bundle, selection: Selection, progress: Callable[[], object] = lambda: None
) -> ScoredDrive:
    """Follow `KIND:DIR`, a recording, or `demo`, by the front end of a run. progress: called after each frame.

    Raises CameraError for data, OdometryError for an odometry that is not available, or data without truth or mount, or
    with fewer than two frames.
    """
    # Prints what the drive's reader leaves out, too: a camera only keeps such notes.
    full = open_drive(spec).full_poses if spec.partition(":")[0] in READERS else None
    with open_camera(spec, CameraOptions(depth=selection.depth)) as camera:
        truth, mount = camera.info.truth, camera.info.mount or selection.mount
        if truth is None:
            raise OdometryError(f"{spec} brings no true poses of its own to compare with")
        if camera.info.intrinsics is None or mount is None:
            missing = "lens" if camera.info.intrinsics is None else "mount"
            raise OdometryError(f"{spec}: {missing} unknown: write it into its camera.yaml, or give --mount")
        if selection.mount is not None:
            mount = replace(mount, height_m=selection.mount.height_m, pitch_rad=selection.mount.pitch_rad)
        if how.odometry == OWN_WHEELS and (camera.info.wheel is None or not how.wheels):
            raise OdometryError(f"{spec}: no wheel odometry comes with it")
        floor, config = FloorCamera(camera.info.intrinsics, mount), replace(selection.config, rest=NO_REST)
        front_end = build_slam(camera, bundle, floor, how, config).pipeline
        observed: list[FrameObservations] = []
        for frame in _chosen(camera, selection):
            observed.append(front_end.step(frame))
            progress()
        if len(observed) < 2:
            first = selection.first
            raise OdometryError(f"{spec}: {len(observed)} frames from frame {first} on, a motion needs two")
        known = camera.info.attitudes
    stamps_s, motions = np.array([one.stamp_s for one in observed]), [one.motion for one in observed[1:]]
    true = [truth.at(stamp_s) for stamp_s in stamps_s]
    true = [true[0].inverse() @ pose for pose in true]
    estimated = integrated([one.motion for one in motions])
    lengths = selection.lengths_m or (KITTI_LENGTHS_M if spec.startswith("kitti:") else INDOOR_LENGTHS_M)
    errors = errors_of(true, estimated, np.array([one.covariance for one in motions]), lengths, stamps_s)
    document: dict[str, Any] = {
        "data": spec,
        "rate_hz": round(1.0 / float(np.median(np.diff(stamps_s))), 3),
        "mount": {"height_m": mount.height_m, "pitch_deg": round(degrees(mount.pitch_rad), 3)},
        "faults": sum(one.blind for one in motions),
        **figures([errors]),
        "attitude": attitude_errors(observed, known, mount.height_m),
    }
    if full is not None:
        chosen = full[selection.first :: selection.every][: len(true)]
        document["planar_fit"] = planar_fit(chosen, lengths)
    return ScoredDrive(true, estimated, errors, document)


def attitude_errors(
    observed: Sequence[FrameObservations], known: AttitudeTrack | None, height_m: float
) -> dict[str, Any]:
    """Figures of the frames' attitudes, against the true ones where they are known. height_m: of the lens at first."""
    true = None if known is None else [known.at(one.stamp_s, height_m) for one in observed]
    return attitude_figures([one.camera.attitude if one.camera else None for one in observed], true)


def _chosen(camera: Camera, selection: Selection) -> Iterator[Frame]:
    """The frames that are evaluated, numbered from 0; each brings the IMU's samples of those left out before it."""
    skipped: list[ImuSamples] = []
    count = 0
    while (selection.frames is None or count < selection.frames) and (frame := camera.read()) is not None:
        skipped.append(frame.imu)
        if frame.index >= selection.first and (frame.index - selection.first) % selection.every == 0:
            yield replace(frame, imu=ImuSamples.joined(skipped), index=count)
            skipped, count = [], count + 1


def together(drives: dict[str, ScoredDrive]) -> dict[str, Any]:
    """The document of `edgemap eval odometry`: figures of each sequence by name, and of all sequences pooled."""
    errors = {name: drive.errors for name, drive in drives.items()}
    total = {"sequences": len(drives), **figures(list(errors.values())), "worst": worst_drive(errors)}
    total["faults"] = sum(drive.document["faults"] for drive in drives.values())
    return {"sequences": {name: drive.document for name, drive in drives.items()}, "total": total}


def sequence_names(specs: Sequence[str]) -> list[str]:
    """A short name of each: the folder's or file's own, the whole SPEC where two would be the same."""
    short = [spec if spec.startswith("sim:") else Path(spec.partition(":")[2] or spec).name or spec for spec in specs]
    return [name if short.count(name) == 1 else spec for name, spec in zip(short, specs, strict=True)]
