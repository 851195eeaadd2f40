"""What `edgemap.open` and `edgemap run` make of a camera and options: the composition root of a run."""

from collections.abc import Collection, Iterable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from edgemap.geometry.camera.floor import FloorCamera
from edgemap.geometry.camera.intrinsics import Intrinsics
from edgemap.geometry.errors import MapError
from edgemap.runtime.frames.camera import Camera, CameraOptions
from edgemap.runtime.frames.errors import BundleError, CameraError
from edgemap.runtime.frames.program_camera import (
    FramesCamera,
    IntrinsicsLike,
    MountLike,
    PushedCamera,
    as_intrinsics,
    as_mount,
)
from edgemap.runtime.frames.reading import user_path
from edgemap.runtime.inputs.cameras.checked import checked
from edgemap.runtime.inputs.cameras.kinds import recorded_from
from edgemap.runtime.inputs.cameras.wheels import replace_wheels
from edgemap.runtime.inputs.drives.camera_yaml import CameraFile, read_camera_yaml
from edgemap.runtime.inputs.open import open_camera
from edgemap.runtime.motion.camera_guess import CameraGuess
from edgemap.runtime.network.bundle import load_bundle
from edgemap.runtime.network.store import bundle_folder, default_bundle
from edgemap.runtime.outputs.notebook import MapObjects
from edgemap.runtime.outputs.sinks.run_folder import RunFolder
from edgemap.runtime.session import Session
from edgemap.runtime.step.config import Config, load_config
from edgemap.runtime.step.grid_file import load_grid
from edgemap.runtime.step.map_file import load_annotated_map, load_last_pose
from edgemap.runtime.step.map_store import find_map
from edgemap.runtime.step.sinks import Sink
from edgemap.runtime.step.slam import SemanticSlam, SlamOptions, build_slam


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
    tree, or a file of one. sinks, strict: see `Session`. Raises CameraError, BundleError, MapError, OdometryError or
    ConfigError in one line.
    """
    guess: CameraGuess | None = None
    if camera_file is not None:
        described = read_camera_yaml(user_path(camera_file))
        guess = _guess_of(described, str(camera_file), intrinsics, mount)
        intrinsics = described.intrinsics if intrinsics is None else intrinsics
        mount = described.mount if mount is None else mount
    tuned = config if isinstance(config, Config) else load_config(Path(config)) if config else Config()
    if camera is not None and frames is not None:
        raise CameraError("give camera= or frames=, not both")

    guessed_height = guess.scale_sigma(odometry) if guess else 0.0

    def build(source: Camera) -> SemanticSlam:
        return _slam_of(source, spec, bundle, classes, SlamOptions(
            replace_wheels(source, odometry), clustering=clustering, loop_closure=loop_closure,
            forgets=map is not None, guessed_height=guessed_height,
        ), tuned, map)  # fmt: skip

    if guess:
        for folder in (sink for sink in sinks if isinstance(sink, RunFolder)):
            folder.add_record({"camera_guess": guess.record()})
    spec = str(camera) if isinstance(camera, str | int | Path) else None
    if camera is None and frames is None and intrinsics is not None:
        if mount is None:
            raise CameraError("pushed pictures: pass mount=(height_m, pitch_deg)")
        return Session(PushedCamera(intrinsics, mount), build, sinks, strict, MapObjects)
    if frames is not None:
        source: Camera = FramesCamera(frames, intrinsics, mount)
    elif camera is None or spec is not None:
        spec = spec or "demo"
        lens = intrinsics if isinstance(intrinsics, Intrinsics) else None  # a webcam is asked for its size
        how = CameraOptions(lens, None if mount is None else as_mount(mount), recovery=tuned.camera)
        source = open_camera(spec, how)
    else:
        source = checked(camera, str(camera.name))  # type: ignore[arg-type, union-attr]
    try:
        if intrinsics is not None:
            source.intrinsics = as_intrinsics(intrinsics, *source.size)
        if mount is not None:
            source.mount = as_mount(mount)
        return Session(source, build(source), sinks, strict, MapObjects)
    except BaseException:
        source.close()
        raise


def _guess_of(
    described: CameraFile, where: str, intrinsics: IntrinsicsLike | None, mount: MountLike | None
) -> CameraGuess | None:
    """What a run guessed of the lens and the mount in its camera.yaml, without what is given beside it."""
    calibration, known = dict(described.calibration), described.mount if mount is None else as_mount(mount)
    if intrinsics is not None:
        calibration["intrinsics"] = "as given"
    if mount is not None:
        calibration["mount"] = "as given"
    return known and CameraGuess.of_record(calibration, described.intrinsics, known, where)


def _slam_of(
    source: Camera,
    spec: str | None,
    bundle: str | Path | None,
    classes: Collection[str] | None,
    options: SlamOptions,
    tuned: Config,
    saved: str | Path | None,
) -> SemanticSlam:
    lens, mount = source.intrinsics, source.mount
    if lens is None or mount is None:
        lacks = "intrinsics=(fx, fy, cx, cy)" if lens is None else "mount=(height_m, pitch_deg)"
        raise CameraError(f"{source.name} brings no {lacks.partition('=')[0]}: pass {lacks} or camera_file=")
    name = str(bundle) if bundle else default_bundle(recorded_from(spec or source.name))[0]
    loaded = load_bundle(bundle_folder(name), pace="camera" if source.live else "files")
    if classes is not None:
        chosen = frozenset([classes] if isinstance(classes, str) else classes)
        if unknown := sorted(chosen - set(loaded.names)):
            raise BundleError(f"classes={', '.join(unknown)}: the bundle knows {', '.join(loaded.names)}")
        options = replace(options, mapped=chosen)
    slam = build_slam(source, loaded, FloorCamera(lens, mount), options, tuned)
    place = None if saved is None else find_map(saved)
    if place is not None and options.clustering == "paper":
        raise MapError("map= goes on by association: the paper's clustering needs every sighting, not their map")
    if place is not None and (place.exists or not place.lives):
        objects, annotations = load_annotated_map(place.path)
        slam.mapper.continue_map(objects, annotations, load_grid(place.path), load_last_pose(place.path))
    return slam
