"""`edgemap.open`: what `edgemap run` would drive, or a loop of your own, as a session."""

import warnings
from collections.abc import Collection, Iterable, Sequence
from dataclasses import replace
from math import degrees, inf
from pathlib import Path
from typing import get_args

import numpy as np
from numpy.typing import NDArray

from edgemap.calibrate.first_pictures import by_first_pictures, earlier_guess
from edgemap.geometry.camera.floor import FloorCamera
from edgemap.geometry.camera.intrinsics import Intrinsics
from edgemap.geometry.camera.mount import Mount
from edgemap.geometry.se2 import SE2
from edgemap.runtime.compose import RunSpec, compose, optics_record
from edgemap.runtime.frames.camera import Camera, CameraOptions
from edgemap.runtime.frames.class_names import read_class_names
from edgemap.runtime.frames.errors import BundleError, CameraError, UsageError
from edgemap.runtime.frames.limits import HIGHEST_M, LOWEST_M
from edgemap.runtime.frames.option_texts import Clustering
from edgemap.runtime.frames.program_camera import (
    FramesCamera,
    IntrinsicsLike,
    MountLike,
    PushedCamera,
    as_intrinsics,
    as_mount,
)
from edgemap.runtime.frames.reading import user_path
from edgemap.runtime.inputs.cameras.checked import CheckedCamera
from edgemap.runtime.inputs.cameras.kinds import recorded_from
from edgemap.runtime.inputs.drives.camera_yaml import read_camera_yaml
from edgemap.runtime.inputs.open import open_camera
from edgemap.runtime.motion.camera_guess import CameraGuess
from edgemap.runtime.network.open_bundle import open_bundle
from edgemap.runtime.network.store import bundle_folder, default_bundle
from edgemap.runtime.outputs.sinks.run_folder import RunFolder
from edgemap.runtime.outputs.verdict.run_counts import RunCounts
from edgemap.runtime.session import Session
from edgemap.runtime.step.config import Config, load_config
from edgemap.runtime.step.sinks import Sink
from edgemap.runtime.step.slam import SemanticSlam


class GuessWarning(UserWarning):
    """Lens or mount were guessed from the first pictures. guess: the values with their standard deviations."""

    def __init__(self, name: str, count: int, guess: CameraGuess) -> None:
        lines = "; ".join(guess.lines())
        measure = "mount=HEIGHT_M, or camera_file=" if guess.height_sigma else "camera_file="
        super().__init__(f"{name}: guessed from {count} pictures: {lines}. Measure: {measure}")
        self.guess = guess


def open_session(
    camera: str | int | Path | Camera | None = None,
    bundle: str | Path | None = None,
    *,
    frames: Iterable[NDArray[np.uint8] | tuple[float, NDArray[np.uint8]]] | None = None,
    intrinsics: IntrinsicsLike | None = None,
    mount: MountLike | float | None = None,
    camera_file: str | Path | None = None,
    map: str | Path | None = None,
    start: str | SE2 | tuple[float, float, float] | None = None,
    classes: Collection[str] | None = None,
    names: str | Path | Sequence[str] | None = None,
    confidence: float | None = None,
    odometry: str = "hybrid",
    pose_frame: str | None = None,
    wheels: bool = True,
    imu: bool = True,
    clustering: str = "default",
    loop_closure: bool = True,
    rate: float | None = None,
    rotate: int = 0,
    config: str | Path | Config | None = None,
    sinks: Sequence[Sink] = (),
    strict: bool = False,
) -> Session:
    """Open what `edgemap run` would drive, or a loop of your own.

    camera: a SPEC, the number of a webcam, a path, or a Camera. frames: any iterable of BGR pictures, uint8 (height,
    width, 3), 10 a second, or of (stamp_s, picture). With neither, intrinsics and mount make a session for
    `Session.push`; without those it is the demo. intrinsics: (fx, fy, cx, cy) in pixels, where the source brings none.
    mount: (height_m, pitch_deg), pitch positive looking down, or the height alone. camera_file: a camera.yaml with
    both, as `run --camera-file`. What a camera= does not bring is guessed from its first pictures as in `run`, with a
    `GuessWarning`; a guessed height is corrected in the drive, and the verdict contains the guess. map: a saved map to
    continue, as `run --map`. start: the pose in it where the run begins, (x_m, y_m, yaw_rad), or dock or last. classes:
    those that go on the map. bundle: by default the one for this kind of pictures. names: of a detector's FILE.onnx
    that states none. wheels, imu: whether those of the source are used. pose_frame, confidence, rate, rotate: as the
    options of `run`. config: a tree, or a file of one. sinks, strict: see `Session`. Raises CameraError, BundleError,
    CalibrationError, UsageError, MapError, OdometryError or ConfigError in one line.
    """
    if camera is not None and frames is not None:
        raise CameraError("give camera= or frames=, not both")
    if frames is not None and not isinstance(frames, Iterable):
        raise CameraError(f"frames={frames!r}: expected pictures, or (stamp_s, picture) pairs")
    if rotate and not isinstance(camera, str | int | Path):
        raise CameraError(f"rotate={rotate}: only the source of a SPEC is turned")
    if rotate not in (0, 90, 180, 270):
        raise UsageError(f"rotate={rotate}: expected 0, 90, 180 or 270 degrees")
    for word, value, most in (("confidence", confidence, 1.0), ("rate", rate, inf)):
        if value is not None and not 0.0 < value <= most:
            raise UsageError(f"{word}={value:g}: expected more than 0" + (", at most 1" if most == 1.0 else ""))
    if clustering not in get_args(Clustering):
        raise UsageError(f"clustering={clustering!r}: expected {' or '.join(get_args(Clustering))}")
    described = None if camera_file is None else read_camera_yaml(user_path(camera_file))
    stated = {name for name, value in (("intrinsics", intrinsics), ("mount", mount)) if value is not None}
    height_m = None
    if isinstance(mount, int | float | np.number):
        height_m, mount, stated = float(mount), None, {*stated, "height"} - {"mount"}
    if described is not None:
        intrinsics = described.intrinsics if intrinsics is None else intrinsics
        mount = described.mount if mount is None else mount
    pose = None if mount is None else as_mount(mount)
    stated_m = pose.height_m if pose and height_m is None and not isinstance(mount, Mount) else height_m
    if stated_m is not None and not LOWEST_M <= stated_m <= HIGHEST_M:
        raise CameraError(f"mount: a lens {stated_m:g} m above the floor, expected {LOWEST_M:g} to {HIGHEST_M:g} m")
    if pose is not None and height_m is not None:
        pose = replace(pose, height_m=height_m)
    if start is not None and not isinstance(start, str):  # as `run --start` has it
        begin = start if isinstance(start, SE2) else SE2(*start)
        start = f"{begin.x_m},{begin.y_m},{degrees(begin.yaw_rad)}"
    tuned = config if isinstance(config, Config) else load_config(Path(config)) if config else Config()
    spec = RunSpec(
        odometry, wheels, imu, clustering, loop_closure, classes=classes, confidence=confidence, pose_frame=pose_frame,
        map=map, start=start, config=tuned,
    )  # fmt: skip
    name = str(camera) if isinstance(camera, str | int | Path) else None
    if camera is None and frames is None and intrinsics is None:
        name = "demo"
    counts = RunCounts({"odometry": odometry})

    def build(source: Camera) -> SemanticSlam:
        usual = default_bundle(recorded_from(name or source.info.name))[0]
        pace = "camera" if source.info.live else "files"
        known = read_class_names(Path(names), BundleError) if isinstance(names, str | Path) else names
        loaded = open_bundle(bundle_folder(str(bundle or usual)), usual, pace=pace, names=known)
        lens, sits = source.info.intrinsics, source.info.mount
        if (lens is None or sits is None) and (name is not None or source.info.live):
            floor, guess, count = by_first_pictures(
                source, lambda: open_camera(name or "", how), name or "", loaded, lens, sits, height_m
            )
            if guess is not None:
                warnings.warn(GuessWarning(source.info.name, count, guess), stacklevel=3)
            source.update_info(intrinsics=floor.intrinsics, mount=floor.mount)
        else:
            floor, given = _floor_of(source), None if camera_file is None else user_path(camera_file)
            guess = earlier_guess(name or "", given, source, floor, stated)
        record = {"camera_guess": guess.record()} if guess else {}
        for folder in (sink for sink in sinks if isinstance(sink, RunFolder)):
            folder.add_record(record)
        counts.record |= record | optics_record(floor)
        return compose(source, loaded, floor, spec, guess)

    lens = intrinsics if isinstance(intrinsics, Intrinsics) else None  # a webcam is asked for its size
    how = CameraOptions(lens, pose, recovery=tuned.camera, rotate=rotate)
    if camera is None and frames is None and intrinsics is not None:
        if pose is None:
            raise CameraError("pushed pictures: pass mount=(height_m, pitch_deg)")
        return Session(PushedCamera(intrinsics, pose), build, sinks, strict, counts, rate)
    if frames is not None:
        source: Camera = FramesCamera(frames)
    elif isinstance(camera, Camera):
        source = CheckedCamera(camera)
    else:
        source = open_camera(name or "demo", how)
    try:
        if intrinsics is not None:
            source.update_info(intrinsics=as_intrinsics(intrinsics, *source.info.size))
        if pose is not None:
            source.update_info(mount=pose)
        elif height_m is not None and source.info.mount is not None:
            source.update_info(mount=replace(source.info.mount, height_m=height_m))
        return Session(source, build(source), sinks, strict, counts, rate)
    except BaseException:
        source.close()
        raise


def _floor_of(source: Camera) -> FloorCamera:
    """Lens and mount of a camera that has both. Raises CameraError."""
    lens, mount = source.info.intrinsics, source.info.mount
    if lens is None or mount is None:
        lacks = "intrinsics=(fx, fy, cx, cy)" if lens is None else "mount=(height_m, pitch_deg)"
        raise CameraError(f"{source.info.name} brings no {lacks.partition('=')[0]}: pass {lacks} or camera_file=")
    return FloorCamera(lens, mount)
