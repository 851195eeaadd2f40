"""The composition root: what `edgemap run` and `edgemap.open` make of a camera, a bundle and options."""

from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass, field, replace
from math import hypot, radians
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from edgemap.geometry.camera.floor import FloorCamera
from edgemap.geometry.camera.intrinsics import Intrinsics
from edgemap.geometry.objects.annotations import Annotations
from edgemap.geometry.se2 import SE2
from edgemap.runtime.frames.camera import Camera, CameraOptions, check_size
from edgemap.runtime.frames.errors import CameraError, UsageError
from edgemap.runtime.frames.notes import collected
from edgemap.runtime.frames.option_texts import known_names, numbers
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
from edgemap.runtime.inputs.cameras.wheels import replace_wheels
from edgemap.runtime.inputs.drives.camera_yaml import CameraFile, read_camera_yaml
from edgemap.runtime.inputs.open import open_camera
from edgemap.runtime.motion.camera_guess import CameraGuess
from edgemap.runtime.network.bundle import Bundle
from edgemap.runtime.network.open_bundle import open_bundle
from edgemap.runtime.network.store import bundle_folder, default_bundle
from edgemap.runtime.outputs.notebook import MapObjects
from edgemap.runtime.outputs.sinks.run_folder import RunFolder
from edgemap.runtime.session import Session
from edgemap.runtime.step.config import Config, load_config
from edgemap.runtime.step.grid_file import load_grid
from edgemap.runtime.step.map_file import load_annotated_map, load_last_pose
from edgemap.runtime.step.map_store import MapPlace, find_map
from edgemap.runtime.step.mapper import Mapper
from edgemap.runtime.step.sinks import Sink
from edgemap.runtime.step.slam import SemanticSlam, SlamOptions, build_slam


@dataclass(frozen=True, slots=True, kw_only=True)
class RunSpec:
    """What a run is made of beside its camera, bundle and sinks.

    odometry, pose_frame: as of `run`. wheels, imu: whether the source's are used. classes: those that go on the map,
    the bundle's where None. confidence: minimum score of a box, the bundle's where None. map: a saved map to continue.
    start: X,Y,YAW_DEG in it, dock or last.
    """

    odometry: str = "hybrid"
    pose_frame: str | None = None
    wheels: bool = True
    imu: bool = True
    clustering: str = "default"
    loop_closure: bool = True
    classes: Collection[str] | None = None
    confidence: float | None = None
    map: str | Path | None = None
    start: str | None = None
    config: Config = field(default_factory=Config)


def compose(
    camera: Camera, bundle: Bundle, floor: FloorCamera, spec: RunSpec, guess: CameraGuess | None = None
) -> SemanticSlam:
    """Front end and back end of a run, in its saved map where it continues one. guess: of the lens and the mount.

    Raises UsageError, OdometryError, CameraError or MapError.
    """
    check_size(camera)
    odometry = replace_wheels(camera, spec.odometry)
    options = SlamOptions(
        odometry,
        spec.wheels,
        spec.imu,
        spec.clustering,
        spec.loop_closure,
        spec.map is not None,
        mapped_classes(spec.classes, bundle),
        spec.confidence,
        guess.scale_sigma(odometry) if guess else 0.0,
        spec.pose_frame,
    )
    config = spec.config
    if guess:  # which the camera's own lengths and rotations depend on
        judge = replace(config.odometry.judge, sigma=hypot(config.odometry.judge.sigma, guess.height_sigma))
        config = replace(config, odometry=replace(config.odometry, judge=judge))
    with collected() as found:  # wheels and poses are read here
        slam = build_slam(camera, bundle, floor, options, config)
    if found:
        camera.update_info(faults=(*camera.info.faults, *found))
    _enter_saved_map(slam.mapper, None if spec.map is None else find_map(spec.map), spec)
    return slam


def mapped_classes(classes: Collection[str] | None, bundle: Bundle) -> frozenset[str]:
    """The classes that go on the map. Raises UsageError for one that the bundle does not know, and for none."""
    if classes is None:
        return bundle.mapped
    chosen = frozenset([classes] if isinstance(classes, str) else classes)
    if unknown := sorted(chosen - set(bundle.names)):
        raise UsageError(f"classes {', '.join(unknown)}: {known_names(unknown, bundle.names, 'the bundle knows')}")
    if not chosen:
        raise UsageError("classes: none is named")
    return chosen


def _enter_saved_map(mapper: Mapper, place: MapPlace | None, spec: RunSpec) -> None:
    """Has the mapper continue a map, where there is one. Raises UsageError or MapError."""
    start = spec.start
    if place is None:
        if start is not None:
            raise UsageError(f"start {start}: a start pose is one in a saved map: name it with --map")
        return
    if spec.clustering == "paper":
        raise UsageError("a saved map goes on by association: the paper's clustering needs every sighting")
    if place.lives and not place.exists:
        if start is not None:
            raise UsageError(f"start {start}: {place.path} is a new map, whose first pose is its origin")
        return
    (objects, annotations), grid = load_annotated_map(place.path), load_grid(place.path)
    last = load_last_pose(place.path)
    if start is not None:
        mapper.start_in(objects, _start_pose(start, annotations, last), annotations=annotations, grid=grid)
    else:
        mapper.continue_map(objects, annotations, grid, last)


def _start_pose(start: str, annotations: Annotations, last: SE2 | None) -> SE2:
    """The pose that a start means. Raises UsageError."""
    starts = {"dock": annotations.dock, "last": last}
    if start not in starts:
        x_m, y_m, yaw_deg = numbers(start, "start", "X,Y,YAW_DEG")
        return SE2(x_m, y_m, radians(yaw_deg))
    pose = starts[start]
    if pose is None:
        lacks = {"dock": "dock (set it on the live page or with PUT /api/dock)", "last": "last pose"}[start]
        raise UsageError(f"start {start}: the map has no {lacks}")
    return pose


def open_session(
    camera: str | int | Path | Camera | None = None,
    bundle: str | Path | None = None,
    *,
    frames: Iterable[NDArray[np.uint8] | tuple[float, NDArray[np.uint8]]] | None = None,
    intrinsics: IntrinsicsLike | None = None,
    mount: MountLike | None = None,
    camera_file: str | Path | None = None,
    map: str | Path | None = None,
    classes: Collection[str] | None = None,
    odometry: str = "hybrid",
    clustering: str = "default",
    loop_closure: bool = True,
    config: str | Path | Config | None = None,
    sinks: Sequence[Sink] = (),
    strict: bool = False,
) -> Session:
    """Open what `edgemap run` would drive, or a loop of your own.

    camera: a SPEC, the number of a webcam, a path, or a Camera. frames: any iterable of BGR pictures, uint8 (height,
    width, 3), 10 a second, or of (stamp_s, picture). With neither, intrinsics and mount make a session for
    `Session.push`; without those it is the demo. intrinsics: (fx, fy, cx, cy) in pixels, where the source brings none.
    mount: (height_m, pitch_deg), positive looking down. camera_file: a camera.yaml with both, as `run --camera-file`;
    `run` writes one into its folder where it guesses them, a session does not guess: a guessed height is corrected as
    in a run, and the verdict of a `RunFolder` among the sinks contains the guess. map: a saved map to continue, as
    `run --map`. classes: those that go on the map. bundle: by default the one for this kind of pictures. config: a
    tree, or a file of one. sinks, strict: see `Session`. Raises CameraError, BundleError, UsageError, MapError,
    OdometryError or ConfigError in one line.
    """
    guess: CameraGuess | None = None
    if camera_file is not None:
        described = read_camera_yaml(user_path(camera_file))
        guess = _guess_of(described, str(camera_file), intrinsics, mount)
        intrinsics = described.intrinsics if intrinsics is None else intrinsics
        mount = described.mount if mount is None else mount
    if camera is not None and frames is not None:
        raise CameraError("give camera= or frames=, not both")
    tuned = config if isinstance(config, Config) else load_config(Path(config)) if config else Config()
    spec = RunSpec(
        odometry=odometry, clustering=clustering, loop_closure=loop_closure, classes=classes, map=map, config=tuned
    )

    def build(source: Camera) -> SemanticSlam:
        loaded = _load(source, name or source.info.name, bundle)
        return compose(source, loaded, _floor_of(source), spec, guess)

    if guess:
        for folder in (sink for sink in sinks if isinstance(sink, RunFolder)):
            folder.add_record({"camera_guess": guess.record()})
    name = str(camera) if isinstance(camera, str | int | Path) else None
    if camera is None and frames is None and intrinsics is not None:
        if mount is None:
            raise CameraError("pushed pictures: pass mount=(height_m, pitch_deg)")
        return Session(PushedCamera(intrinsics, mount), build, sinks, strict, MapObjects)
    if frames is not None:
        source: Camera = FramesCamera(frames, intrinsics, mount)
    elif camera is None or name is not None:
        name = name or "demo"
        lens = intrinsics if isinstance(intrinsics, Intrinsics) else None  # a webcam is asked for its size
        how = CameraOptions(lens, None if mount is None else as_mount(mount), recovery=tuned.camera)
        source = open_camera(name, how)
    else:
        source = CheckedCamera(camera)
    try:
        if intrinsics is not None:
            source.update_info(intrinsics=as_intrinsics(intrinsics, *source.info.size))
        if mount is not None:
            source.update_info(mount=as_mount(mount))
        return Session(source, build(source), sinks, strict, MapObjects)
    except BaseException:
        source.close()
        raise


def _guess_of(
    described: CameraFile, where: str, intrinsics: IntrinsicsLike | None, mount: MountLike | None
) -> CameraGuess | None:
    """What a run guessed of the lens and the mount in its camera.yaml, without what is stated now."""
    current = described.mount if mount is None else as_mount(mount)
    stated = {name for name, value in (("intrinsics", intrinsics), ("mount", mount)) if value is not None}
    return current and CameraGuess.of_record(described.calibration, described.intrinsics, current, where, stated)


def _load(source: Camera, spec: str, bundle: str | Path | None) -> Bundle:
    """The bundle of that name, or the default one of the source. Raises BundleError."""
    usual = default_bundle(recorded_from(spec))[0]
    return open_bundle(bundle_folder(str(bundle or usual)), usual, pace="camera" if source.info.live else "files")


def _floor_of(source: Camera) -> FloorCamera:
    """Lens and mount of a camera that has both. Raises CameraError."""
    lens, mount = source.info.intrinsics, source.info.mount
    if lens is None or mount is None:
        lacks = "intrinsics=(fx, fy, cx, cy)" if lens is None else "mount=(height_m, pitch_deg)"
        raise CameraError(f"{source.info.name} brings no {lacks.partition('=')[0]}: pass {lacks} or camera_file=")
    return FloorCamera(lens, mount)
