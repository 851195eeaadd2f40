"""A camera, its front end and its back end as one object to iterate over: what `edgemap.open` gives."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from types import TracebackType

from edgemap.geometry.camera.floor import FloorCamera
from edgemap.geometry.camera.mount import Mount
from edgemap.geometry.objects.map_object import MapObject
from edgemap.runtime.attitude.open import open_attitude
from edgemap.runtime.bundle import load_bundle
from edgemap.runtime.cameras import Camera, open_camera
from edgemap.runtime.config import Config, load_config
from edgemap.runtime.default_bundle import default_bundle
from edgemap.runtime.errors import CameraError
from edgemap.runtime.map_file import save_map
from edgemap.runtime.mapper import new_mapper
from edgemap.runtime.odometry import open_odometry
from edgemap.runtime.pipeline import Pipeline
from edgemap.runtime.slam import SemanticSlam, StepResult
from edgemap.runtime.store import bundle_folder


class Session:
    """Iterate for one `StepResult` a frame; `map` is the map so far. A context manager that closes the camera."""

    def __init__(self, camera: Camera, slam: SemanticSlam) -> None:
        self.camera, self.slam = camera, slam

    def __iter__(self) -> Iterator[StepResult]:
        while (frame := self.camera.read()) is not None:
            yield self.slam.step(frame)

    @property
    def map(self) -> list[MapObject]:
        """The objects as they stand now, ordered by id."""
        return self.slam.objects()

    def save(self, path: str | Path) -> None:
        """Write the map as map.json, atomically. Raises MapError."""
        save_map(Path(path), self.map)

    def close(self) -> None:
        """Let go of the camera."""
        self.camera.close()

    def __enter__(self) -> Session:
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
) -> Session:
    """Open what `edgemap run` would drive: a camera by its SPEC, a bundle by name or folder, and an empty map.

    bundle: by default the one for this kind of pictures. mount: where the source brings none. config: a tree, or a file
    of one. Raises CameraError, BundleError, OdometryError or ConfigError in one line.
    """
    tuned = config if isinstance(config, Config) else load_config(Path(config))[0] if config else Config()
    source = open_camera(camera) if isinstance(camera, str) else camera
    try:
        lens, seat = source.intrinsics, mount or source.mount
        if lens is None or seat is None:
            lacks = "intrinsics" if lens is None else "mount"
            raise CameraError(
                f"{source.name} brings no {lacks}: give its camera.yaml, or mount=Mount(height_m, pitch_rad)"
            )
        name = str(bundle) if bundle else default_bundle(camera if isinstance(camera, str) else source.name)[0]
        loaded = load_bundle(bundle_folder(name), pace="camera" if source.live else "files")
        floor = FloorCamera(lens, seat)
        motion = open_odometry(odometry, loaded, source, floor, rules=tuned.odometry)
        attitude = open_attitude(odometry, source, seat, rule=tuned.attitude)
        pipeline = Pipeline(loaded, floor, motion, rule=tuned.floor, attitude=attitude, health=tuned.health)
        return Session(source, SemanticSlam(pipeline, new_mapper(tuned, clustering, odometry, loop_closure)))
    except BaseException:
        source.close()
        raise
