"""Front end and back end for a camera, by one builder, and all three as one object to iterate over."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from types import TracebackType

from edgemap.geometry.camera.floor import FloorCamera
from edgemap.geometry.camera.mount import Mount
from edgemap.runtime.attitude.open import open_attitude
from edgemap.runtime.bundle import Bundle, load_bundle
from edgemap.runtime.cameras import Camera, open_camera
from edgemap.runtime.config import Config, load_config
from edgemap.runtime.errors import CameraError
from edgemap.runtime.loop import steps
from edgemap.runtime.map_file import save_map
from edgemap.runtime.mapper import new_mapper
from edgemap.runtime.notebook import MapObjects
from edgemap.runtime.odometry import open_odometry
from edgemap.runtime.pipeline import Pipeline
from edgemap.runtime.sinks.group import Sink
from edgemap.runtime.slam import SemanticSlam, StepResult
from edgemap.runtime.store import bundle_folder, default_bundle


class Session:
    """Iterate for one `StepResult` a frame; `map` is the map so far. A context manager that closes the camera.

    The loop is that of `edgemap run`: a camera fault ends nothing (strict: it is raised) and stands in the `faults` of
    the next result; while a live camera is away wheels and gyro carry the pose, and `camera.state` says so. Iteration
    that was left goes on where it was. sinks: where results go as well; they are closed with the last frame.
    """

    def __init__(self, camera: Camera, slam: SemanticSlam, sinks: Sequence[Sink] = (), strict: bool = False) -> None:
        self.camera, self.slam = camera, slam
        self._steps = steps(camera, slam, sinks, strict=strict)

    def __iter__(self) -> "Session":
        return self

    def __next__(self) -> StepResult:
        """The next frame's result. Raises CameraLostError for good, or what else `steps` does."""
        return next(self._steps)

    @property
    def map(self) -> MapObjects:
        """The objects as they stand now, ordered by id; in a notebook, the map from above."""
        return MapObjects(self.slam.objects(), self.slam.mapper.trajectory)

    def save(self, path: str | Path) -> None:
        """Write the map as map.json, atomically. Raises MapError."""
        save_map(Path(path), self.map, self.slam.mapper.annotations())

    def close(self) -> None:
        """Close the sinks and let go of the camera."""
        try:
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
    camera: str | Camera = "demo",
    bundle: str | Path | None = None,
    *,
    odometry: str = "hybrid",
    mount: Mount | None = None,
    clustering: str = "default",
    loop_closure: bool = True,
    config: str | Path | Config | None = None,
    sinks: Sequence[Sink] = (),
    strict: bool = False,
) -> Session:
    """Open what `edgemap run` would drive: a camera by its SPEC, a bundle by name or folder, and an empty map.

    bundle: by default the one for this kind of pictures. mount: where the source brings none. config: a tree, or a file
    of one. sinks, strict: see `Session`. Raises CameraError, BundleError, OdometryError or ConfigError in one line.
    """
    tuned = config if isinstance(config, Config) else load_config(Path(config))[0] if config else Config()
    source = open_camera(camera, recovery=tuned.camera) if isinstance(camera, str) else camera
    try:
        lens, camera_mount = source.intrinsics, mount or source.mount
        if lens is None or camera_mount is None:
            lacks = "intrinsics" if lens is None else "mount"
            raise CameraError(
                f"{source.name} brings no {lacks}: give its camera.yaml, or mount=Mount(height_m, pitch_rad)"
            )
        name = str(bundle) if bundle else default_bundle(camera if isinstance(camera, str) else source.name)[0]
        loaded = load_bundle(bundle_folder(name), pace="camera" if source.live else "files")
        floor = FloorCamera(lens, camera_mount)
        options = SlamOptions(odometry, clustering=clustering, loop_closure=loop_closure)
        return Session(source, build_slam(source, loaded, floor, options, tuned), sinks, strict)
    except BaseException:
        source.close()
        raise


@dataclass(frozen=True, slots=True)
class SlamOptions:
    """What a run chooses, beside what is tuned. The defaults are those of `edgemap run`.

    odometry: a SPEC. wheels, imu: whether those that the source brings are used. clustering: default or paper. forgets:
    whether objects that are gone leave the map. mapped, confidence: the bundle's own where None.
    """

    odometry: str = "hybrid"
    wheels: bool = True
    imu: bool = True
    clustering: str = "default"
    loop_closure: bool = True
    forgets: bool = False
    allow_untrained: bool = False
    mapped: Collection[str] | None = None
    confidence: float | None = None


def build_slam(
    camera: Camera, bundle: Bundle, floor: FloorCamera, options: SlamOptions | None = None, config: Config | None = None
) -> SemanticSlam:
    """An empty map and all that fills it. floor: the camera's lens and mount. Raises OdometryError."""
    options, config = options or SlamOptions(), config or Config()
    odometry = open_odometry(
        options.odometry, bundle, camera, floor, options.allow_untrained, options.wheels, config.odometry
    )
    pipeline = Pipeline(
        bundle,
        floor,
        odometry,
        rule=replace(config.floor, mapped=options.mapped),
        attitude=open_attitude(options.odometry, camera, floor, options.imu, config.attitude),
        confidence=options.confidence,
        health=config.health,
        rest=config.rest,
        height=config.height,
    )
    forgets = floor if options.forgets else None
    mapper = new_mapper(config, options.clustering, options.odometry, options.loop_closure, forgets)
    return SemanticSlam(pipeline, mapper)
