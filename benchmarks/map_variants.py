"""Maps of one drive made in several ways at once: its pictures are read and the backbone runs once for all of them."""

from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from edgemap.evaluation.grid import FLAT_M, OVERHEAD_M, TrueFloor
from edgemap.evaluation.objects import TrueObject
from edgemap.geometry.camera.attitude import Attitude
from edgemap.geometry.camera.floor import FloorCamera
from edgemap.geometry.map_object import MapObject
from edgemap.geometry.observations.sighting import FloorRule, sightings_of
from edgemap.runtime.frames.errors import CameraError
from edgemap.runtime.frames.frame import Frame
from edgemap.runtime.inputs.cameras.pictures import drive_camera
from edgemap.runtime.inputs.drives import Drive
from edgemap.runtime.inputs.drives.truth import read_floor_plan
from edgemap.runtime.motion.attitude.open import open_attitude
from edgemap.runtime.motion.odometry import Motion, Odometry, open_odometry
from edgemap.runtime.motion.odometry.protocol import NO_PRIOR, FramePrior
from edgemap.runtime.network.bundle import Bundle
from edgemap.runtime.network.network import Tensors
from edgemap.runtime.step.config import Config
from edgemap.runtime.step.frame_observations import FrameObservations
from edgemap.runtime.step.mapper import Mapper, new_mapper
from edgemap.runtime.step.pipeline import Pipeline


@dataclass(frozen=True, slots=True)
class Variant:
    """odometry: as of `open_odometry`; wheels: whether hybrid may use the drive's. clustering: default or paper."""

    odometry: str = "hybrid"
    wheels: bool = True
    loop_closure: bool = True
    clustering: str = "default"

    def mapper(self, config: Config) -> Mapper:
        """An empty back end."""
        return new_mapper(config, self.clustering, self.odometry, self.loop_closure)


class SideBySide:
    """Several odometries on the same frames; `motions` holds what each made of the last one."""

    name = "several"

    def __init__(self, odometries: Mapping[Any, Odometry]) -> None:
        self.odometries, self.motions = dict(odometries), dict[Any, Motion]()
        self.needs_features = any(odometry.needs_features for odometry in self.odometries.values())

    def step(self, frame: Frame, features: Tensors, prior: FramePrior = NO_PRIOR) -> Motion:
        """Steps all odometries. Returns the first one's motion."""
        self.motions = {
            key: odometry.step(frame, features, prior).checked(odometry.name)
            for key, odometry in self.odometries.items()
        }
        return next(iter(self.motions.values()))

    def step_blind(self, stamp_s: float, reason: str, attitude: Attitude | None = None) -> Motion:
        """Steps all odometries without a picture. Returns the first one's motion."""
        blind = {key: odometry.step_blind(stamp_s, reason, attitude) for key, odometry in self.odometries.items()}
        self.motions = blind
        return next(iter(blind.values()))

    def still(self, stamp_s: float, attitude: Attitude | None) -> bool | None:
        """True where all sources report rest, False where one does not."""
        answers = [odometry.still(stamp_s, attitude) for odometry in self.odometries.values()]
        return False if False in answers else None if None in answers else True

    def rest(self, stamp_s: float) -> Motion:
        """Passes the call to every odometry."""
        self.motions = {key: odometry.rest(stamp_s) for key, odometry in self.odometries.items()}
        return next(iter(self.motions.values()))

    def reset(self, reason: str) -> None:
        """Passes the call to every odometry."""
        for odometry in self.odometries.values():
            odometry.reset(reason)


@dataclass(frozen=True, slots=True)
class Replay:
    """A drive, its bundle, and the data that all variants share. frames: the first ones, None for all. confidence: the
    bundle's own where None. imu: whether the drive's may be used.
    """

    drive: Drive
    bundle: Bundle
    frames: int | None = None
    confidence: float | None = None
    config: Config = field(default_factory=Config)
    imu: bool = True


def map_drive(replay: Replay, variants: Mapping[str, Variant]) -> dict[str, list[MapObject]]:
    """The map that each variant makes of the drive's first frames, as `run` would. Raises what `observed_by` raises."""
    return {name: mapper.objects() for name, mapper in mappers_of(replay, variants).items()}


def mappers_of(replay: Replay, variants: Mapping[str, Variant]) -> dict[str, Mapper]:
    """Each variant's back end after the drive's first frames: its objects and its floor."""
    mappers = {name: variant.mapper(replay.config) for name, variant in variants.items()}
    for observed in observed_by(replay, variants):
        for name, mapper in mappers.items():
            mapper.step(observed[name])
    return mappers


def true_floor(drive: Drive) -> TrueFloor | None:
    """The drive's floor plan, where it has one. What hangs high over the floor, or is flat, is no obstacle. Raises
    CameraError."""
    plan = read_floor_plan(drive.folder)
    if plan is None:
        return None
    standing = [item for item in plan.footprints if item.low_m <= OVERHEAD_M and item.high_m > FLAT_M]
    floor, walls, footprints = (
        [np.array(area.corners_m) for area in areas] for areas in ([*plan.rooms, *plan.doorways], plan.walls, standing)
    )
    return TrueFloor(floor, walls, footprints)


def observed_by(replay: Replay, variants: Mapping[str, Variant]) -> Iterator[dict[str, FrameObservations]]:
    """The front end's observations of each of the drive's first frames, for each variant.

    Poses that are given bring their attitudes, or leave them at the mount's; other variants see the floor by the IMU's,
    where `imu` and the drive allow it, or by the pictures'.
    Raises CameraError for a drive without intrinsics or mount, OdometryError for an odometry that cannot be had.
    """
    drive, bundle, config, frames = replay.drive, replay.bundle, replay.config, replay.frames
    with drive_camera(drive, str(drive.folder)) as camera:
        if camera.intrinsics is None or camera.mount is None:
            raise CameraError(f"{drive.folder}: neither intrinsics nor mount known")
        floor = FloorCamera(camera.intrinsics, camera.mount)
        sources = dict.fromkeys((variant.odometry, variant.wheels) for variant in variants.values())
        sources = sorted(sources, key=lambda source: source[0] == "truth")  # the first one's motion gives the attitude
        rules = config.odometry, config.health, config.attitude.check.tilt
        odometry = SideBySide(
            {
                (spec, wheels): open_odometry(spec, bundle, camera, floor, False, wheels, *rules)
                for spec, wheels in sources
            }
        )
        estimated, given = (
            open_attitude(spec, camera, floor, replay.imu, config.attitude, config.health)
            for spec in ("estimated", "truth")
        )
        pipeline = Pipeline(
            bundle,
            floor,
            odometry,
            rule=config.floor,
            attitude=estimated,
            confidence=replay.confidence,
            health=config.health,
            rest=config.rest,
            height=config.height,
        )
        while (frame := camera.read()) is not None and (frames is None or frame.index < frames):
            observed = pipeline.step(frame)
            motions, attitude = odometry.motions, given.predict(frame)
            if attitude.predicted:  # poses track no corners
                attitude = given.update(next((m.rotation for (spec, _), m in motions.items() if spec == "truth"), None))
            true = at_attitude(observed, floor.at(attitude), pipeline.rule, frame.depth)
            yield {
                name: replace(
                    true if variant.odometry == "truth" and attitude.source != "imu" else observed,
                    motion=motions[variant.odometry, variant.wheels],
                )
                for name, variant in variants.items()
            }


def at_attitude(
    observed: FrameObservations, camera: FloorCamera, rule: FloorRule, depth: NDArray[np.float32] | None = None
) -> FrameObservations:
    """The same boxes on the floor as another attitude has it; none where the picture was not searched."""
    if not observed.searched:
        return replace(observed, camera=camera)
    sightings = sightings_of(observed.detections, camera, rule, observed.index, observed.stamp_s, depth, observed.floor)
    return replace(observed, sightings=sightings, camera=camera)


def true_objects(drive: Drive, frames: int | None = None) -> list[TrueObject]:
    """The drive's objects, each with the number of frames in which it is visible: by boxes.json where there is one."""
    seen: Counter[str] = Counter()
    for boxes in drive.boxes[:frames]:
        seen.update(boxes.visible_ids())
    frames_seen = seen if drive.boxes else None
    return [true_object(item, frames_seen) for item in drive.objects]


def true_object(record: Mapping[str, Any], seen: Mapping[str, int] | None = None) -> TrueObject:
    """A record of objects.json; seen: the number of frames that show each id; None takes the record's."""
    frames = int(record.get("visible_frames") or 0) if seen is None else seen.get(str(record["id"]), 0)
    footprint = tuple((float(x_m), float(y_m)) for x_m, y_m in record.get("footprint_m") or ())
    return TrueObject(record["label"], record["x_m"], record["y_m"], record["on_floor"], frames, footprint)
