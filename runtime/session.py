"""A camera, the front end and the back end as one object, to iterate over or to push pictures to."""

from collections.abc import Callable, Collection, Generator, Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from types import TracebackType

import numpy as np
from numpy.typing import NDArray

from edgemap.calibrate.guess import CameraGuess
from edgemap.geometry.camera.floor import FloorCamera
from edgemap.geometry.camera.imu import ImuSamples
from edgemap.geometry.camera.intrinsics import Intrinsics
from edgemap.geometry.errors import MapError
from edgemap.geometry.se2 import SE2
from edgemap.runtime.frames.errors import BundleError, CameraError
from edgemap.runtime.frames.reading import user_path
from edgemap.runtime.inputs.cameras.checked import CheckedCamera
from edgemap.runtime.inputs.cameras.given import (
    FramesCamera,
    IntrinsicsLike,
    MountLike,
    PushedCamera,
    as_intrinsics,
    as_mount,
)
from edgemap.runtime.inputs.cameras.protocol import Camera
from edgemap.runtime.inputs.drives.camera_yaml import CameraFile, read_camera_yaml
from edgemap.runtime.inputs.open import open_camera
from edgemap.runtime.network.bundle import load_bundle
from edgemap.runtime.network.store import bundle_folder, default_bundle
from edgemap.runtime.outputs.notebook import MapObjects
from edgemap.runtime.outputs.sinks.run_folder import RunFolder
from edgemap.runtime.step.config import Config, load_config
from edgemap.runtime.step.grid_file import load_grid
from edgemap.runtime.step.loop import steps
from edgemap.runtime.step.map_file import load_annotated_map, load_last_pose, save_map
from edgemap.runtime.step.map_store import find_map
from edgemap.runtime.step.sinks import Sink
from edgemap.runtime.step.slam import SemanticSlam, SlamOptions, StepResult, build_slam


class Session:
    """Iterate for one `StepResult` a frame, or push pictures; `map` is the map so far. A context manager.

    The loop is that of `edgemap run`: a camera fault does not end it (strict: it is raised) and is in the `faults` of
    the next result. While a live camera is away, wheels and gyro update the pose, and `camera.state` reports it. A
    loop that was left can be resumed. sinks: where results go as well; they are closed with the last frame.
    """

    def __init__(
        self,
        camera: Camera,
        slam: SemanticSlam | Callable[[Camera], SemanticSlam],
        sinks: Sequence[Sink] = (),
        strict: bool = False,
    ) -> None:
        """slam: front end and back end, or what makes them once the first pushed picture is there."""
        own = type(camera).__module__.startswith("edgemap.")
        self.camera = camera if own else CheckedCamera(camera, str(camera.name))
        self._slam, self._sinks, self._strict = slam, sinks, strict
        self._steps: Generator[StepResult, None, None] | None = None

    @property
    def slam(self) -> SemanticSlam:
        """Front end and back end. Raises CameraError before the first pushed picture."""
        if not isinstance(self._slam, SemanticSlam):
            raise CameraError("no picture has been pushed yet")
        return self._slam

    def push(
        self,
        image: NDArray[np.uint8],
        stamp_s: float,
        *,
        imu: ImuSamples | NDArray[np.float64] | None = None,
        wheels: SE2 | tuple[float, float, float] | None = None,
    ) -> StepResult:
        """One step with a picture of your own: BGR, uint8 (height, width, 3), at a stamp that rises.

        imu: samples since the picture before: (N, 7) stamp_s, gyro x y z (rad/s), accelerometer x y z (m/s^2) in the
        camera's optical axes. wheels: pose of the wheel odometry at the stamp, (x_m, y_m, yaw_rad), with every picture
        or with none. Raises CameraError for an invalid picture, and for a session that is closed or reads a camera.
        """
        if not isinstance(self.camera, PushedCamera):
            raise CameraError(
                f"this session reads {self.camera.name}: to push, open one with intrinsics= and mount= alone"
            )
        self.camera.give(image, stamp_s, imu, wheels)
        if not isinstance(self._slam, SemanticSlam):
            self._slam = self._slam(self.camera)
        try:
            return next(self._running())
        except StopIteration:
            raise CameraError("this session is closed: open another one to push pictures") from None

    def _running(self) -> Generator[StepResult, None, None]:
        """The loop, begun with the first step."""
        if self._steps is None:
            self._steps = steps(self.camera, self.slam, self._sinks, strict=self._strict)
        return self._steps

    def __iter__(self) -> "Session":
        return self

    def __next__(self) -> StepResult:
        """The next frame's result. Raises CameraLostError for good, or what else `steps` does."""
        if isinstance(self.camera, PushedCamera):
            raise CameraError("this session has no camera to read: push pictures, or open it with camera= or frames=")
        return next(self._running())

    @property
    def map(self) -> MapObjects:
        """The objects as they stand now, ordered by id; in a notebook, the map from above."""
        if not isinstance(self._slam, SemanticSlam):
            return MapObjects()
        return MapObjects(self.slam.objects(), self.slam.mapper.trajectory)

    def save(self, path: str | Path) -> None:
        """Write the map as map.json, atomically. Raises MapError."""
        mapper = self.slam.mapper
        save_map(Path(path), self.map, mapper.annotations(), mapper.grid.grid())

    def close(self) -> None:
        """Close the sinks and the camera."""
        try:
            if self._steps is not None:
                self._steps.close()
        finally:
            self.camera.close()

    def __enter__(self) -> "Session":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


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
        return _slam_of(source, spec, bundle, classes, SlamOptions(odometry, clustering=clustering,
                        loop_closure=loop_closure, forgets=map is not None, guessed_height=guessed_height),
                        tuned, map)  # fmt: skip

    if guess:
        for folder in (sink for sink in sinks if isinstance(sink, RunFolder)):
            folder.add_record({"camera_guess": guess.record()})
    spec = str(camera) if isinstance(camera, str | int | Path) else None
    if camera is None and frames is None and intrinsics is not None:
        if mount is None:
            raise CameraError("pushed pictures: pass mount=(height_m, pitch_deg)")
        return Session(PushedCamera(intrinsics, mount), build, sinks, strict)
    if frames is not None:
        source: Camera = FramesCamera(frames, intrinsics, mount)
    elif camera is None or spec is not None:
        spec = spec or "demo"
        lens = intrinsics if isinstance(intrinsics, Intrinsics) else None  # a webcam is asked for its size
        source = open_camera(
            spec, intrinsics=lens, recovery=tuned.camera, mount=None if mount is None else as_mount(mount)
        )
    else:
        source = camera  # type: ignore[assignment]
    try:
        if intrinsics is not None:
            source.intrinsics = as_intrinsics(intrinsics, *source.size)
        if mount is not None:
            source.mount = as_mount(mount)
        return Session(source, build(source), sinks, strict)
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
    name = str(bundle) if bundle else default_bundle(spec or source.name)[0]
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
