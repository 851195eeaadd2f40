"""What `edgemap run` and `edgemap.open` make of a camera, a bundle and options."""

from collections.abc import Collection
from dataclasses import asdict, dataclass, field, replace
from math import hypot, radians
from pathlib import Path
from typing import Any

from edgemap.geometry.camera.floor import FloorCamera
from edgemap.geometry.objects.annotations import Annotations
from edgemap.geometry.se2 import SE2
from edgemap.runtime.frames.camera import Camera, check_size
from edgemap.runtime.frames.errors import UsageError
from edgemap.runtime.frames.faults import collected
from edgemap.runtime.frames.option_texts import known_names, numbers
from edgemap.runtime.inputs.cameras.kinds import read_wheels
from edgemap.runtime.inputs.drives.camera_yaml import mount_fields
from edgemap.runtime.motion.camera_guess import CameraGuess
from edgemap.runtime.motion.odometry.judged import JudgedOdometry
from edgemap.runtime.network.bundle import Bundle
from edgemap.runtime.step.config import Config
from edgemap.runtime.step.grid_file import load_grid
from edgemap.runtime.step.map_file import load_annotated_map
from edgemap.runtime.step.map_store import AUTO, MapPlace, find_map
from edgemap.runtime.step.mapper import Mapper
from edgemap.runtime.step.relocalisation import SavedMap
from edgemap.runtime.step.slam import SemanticSlam, SlamOptions, build_slam

WORDS = "dock", "last"  # poses that the saved map knows


@dataclass(frozen=True, slots=True, kw_only=True)
class RunSpec(SlamOptions):
    """What a run is made of besides its camera, bundle and sinks. map: a saved map to continue. start: X,Y,YAW_DEG in
    it, dock or last.
    """

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
    odometry, config, classes = spec.odometry, spec.config, mapped_classes(spec.classes, bundle)
    if guess:  # which the camera's own lengths and rotations depend on
        judge = replace(config.odometry.judge, sigma=hypot(config.odometry.judge.sigma, guess.height_sigma))
        config = replace(config, odometry=replace(config.odometry, judge=judge))
    with collected() as read:  # the wheels, and the poses of others
        if odometry.startswith("wheel:"):
            camera.update_info(wheel=read_wheels(odometry.removeprefix("wheel:")))
            odometry = "wheel"
        sigma, forgets = guess.scale_sigma(odometry) if guess else 0.0, spec.map is not None
        options = replace(spec, odometry=odometry, forgets=forgets, classes=classes, guessed_height=sigma)
        slam = build_slam(camera, bundle, floor, options, config)
    camera.update_info(faults=(*camera.info.faults, *read))
    given = slam.pipeline.odometry.start if isinstance(slam.pipeline.odometry, JudgedOdometry) else None
    _enter_saved_map(
        slam.mapper, None if spec.map is None or str(spec.map) == AUTO else find_map(spec.map), spec, given
    )
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


def _enter_saved_map(mapper: Mapper, place: MapPlace | None, spec: RunSpec, given: SE2 | None) -> None:
    """Has the mapper continue a map, where there is one. given: the first pose, by a source that has a map frame.
    Raises UsageError or MapError."""
    start = spec.start
    if given is not None and start is None:
        mapper.pose_map_base = given  # in which a new map begins
    if place is None:
        if start is not None:
            raise UsageError(f"start {start}: a start pose is one in a saved map (--map, map=)")
        return
    if spec.clustering == "paper":
        raise UsageError("a saved map goes on by association: the paper's clustering needs every sighting")
    if place.lives and not place.exists:  # its first pose is its origin, and the dock where no other is set
        if start not in (None, *WORDS):
            raise UsageError(f"start {start}: {place.path} is a new map, whose first pose is its origin")
        return
    saved = SavedMap(*load_annotated_map(place.path), load_grid(place.path))
    begin = given if start is None else _start_pose(start, saved.annotations)
    if begin is not None:
        mapper.start_in(saved, begin)
    else:
        mapper.continue_map(saved)


def _start_pose(start: str, annotations: Annotations) -> SE2:
    """The pose that a start means; without a dock, the map's origin is one. Raises UsageError."""
    if start == "dock":
        return annotations.dock or SE2()
    if start == "last":
        if annotations.last_pose is None:
            raise UsageError("start last: the map has no last pose")
        return annotations.last_pose
    if "," not in start:
        raise UsageError(f"start {start}: expected {', '.join(WORDS)} or X,Y,YAW_DEG")
    x_m, y_m, yaw_deg = numbers(start, "start", "X,Y,YAW_DEG")
    return SE2(x_m, y_m, radians(yaw_deg))


def optics_record(floor: FloorCamera) -> dict[str, Any]:
    """Lens and mount as run.json holds them."""
    mount = mount_fields(floor.mount, 6) | {"platform": floor.mount.platform}
    return {"intrinsics": asdict(floor.intrinsics), "mount": mount}
