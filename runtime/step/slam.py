"""The step as one object: front end and back end, from parts or from a camera, a bundle and options."""

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace
from functools import partial
from math import degrees
from typing import Any

import numpy as np

from edgemap.geometry.camera.floor import FloorCamera
from edgemap.geometry.map_object import MapObject
from edgemap.geometry.objects.forgetting import Forgetter
from edgemap.geometry.observations.detections import Detections
from edgemap.geometry.paper.paper_map import PaperMap
from edgemap.runtime.frames.camera import Camera
from edgemap.runtime.frames.errors import MissingExtraError
from edgemap.runtime.frames.extras import pip
from edgemap.runtime.frames.faults import Fault
from edgemap.runtime.frames.frame import Frame
from edgemap.runtime.motion.attitude.estimator import open_attitude
from edgemap.runtime.motion.health import PictureHealth
from edgemap.runtime.motion.odometry import open_odometry
from edgemap.runtime.motion.odometry.judged import JudgedOdometry
from edgemap.runtime.motion.odometry.protocol import Motion
from edgemap.runtime.motion.odometry_names import is_pose_file, is_tf
from edgemap.runtime.network.bundle import Bundle
from edgemap.runtime.step.config import Config
from edgemap.runtime.step.frame_observations import FrameObservations
from edgemap.runtime.step.mapper import Mapper, MapUpdate
from edgemap.runtime.step.pipeline import Pipeline
from edgemap.runtime.step.wall_clock import ClockReading, stream_clock


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class StepResult(MapUpdate):
    """Result of one step: the frame, the front end's observations, and the back end's update. faults: all since the
    previous result: of delivery, of sinks, of picture, mount and motion. stages_ms: time of every stage of the step, in
    order. pictured: the frame that detections, sightings and floor_scan are of: an earlier one where the detector is
    asynchronous.
    """

    frame: Frame
    observed: FrameObservations
    pictured: Frame
    faults: tuple[Fault, ...] = ()

    @classmethod
    def of(
        cls,
        frame: Frame,
        observed: FrameObservations,
        update: MapUpdate,
        faults: Sequence[Fault] = (),
        pictured: Frame | None = None,
    ) -> "StepResult":
        """The result of a frame's observations and the update by them. faults: outside of the step, since the last."""
        updated: dict[str, Any] = vars(update) | {"stages_ms": observed.stages_ms | update.stages_ms}
        every = (*faults, *observed.faults)
        return cls(frame=frame, observed=observed, pictured=pictured or frame, faults=every, **updated)

    def __repr__(self) -> str:
        """One line; the fields hold whole pictures."""
        pose, boxes = self.pose_map_base, f"{len(self.detections.boxes)} boxes, {len(self.sightings)} on the floor"
        return (
            f"<StepResult of frame {self.frame.index} at {self.frame.stamp_s:.2f} s: x {pose.x_m:.2f} m, "
            f"y {pose.y_m:.2f} m, yaw {degrees(pose.yaw_rad):.1f} deg; {boxes}>"
        )

    def _repr_png_(self) -> bytes:
        """In a notebook: the picture with all boxes, those on the floor with their distance."""
        from edgemap.runtime.frames.frame import png
        from edgemap.runtime.step.overlay import draw_detections

        sightings = [placed.sighting for placed in self.sightings]
        return png(draw_detections(self.pictured.image, self.detections, sightings))

    def to_supervision(self) -> Any:
        """All boxes as `supervision.Detections`, names in `data["class_name"]`. Raises MissingExtraError without that
        package."""
        try:
            import supervision
        except ImportError:
            raise MissingExtraError(f"supervision's detections need the package: {pip()} install supervision") from None
        return supervision.Detections(
            xyxy=self.detections.boxes.astype(np.float32),
            confidence=self.detections.scores.astype(np.float32),
            class_id=self.detections.class_ids.astype(int),
            data={"class_name": np.array(self.detections.labels, dtype=str)},
        )

    @property
    def detections(self) -> Detections:
        """All boxes of the frame `pictured`."""
        return self.observed.detections

    @property
    def motion(self) -> Motion:
        """Motion of the base since the previous frame."""
        return self.observed.motion

    @property
    def health(self) -> PictureHealth:
        """Health of the picture; an unusable one has no observations."""
        return self.observed.health

    @property
    def object_of_box(self) -> dict[int, str]:
        """The object of each box on the floor, by the box's row in `detections`."""
        return {
            placed.sighting.detection: identity
            for placed, identity in zip(self.sightings, self.object_ids, strict=True)
        }


class SemanticSlam:
    """Front end and back end behind one method."""

    def __init__(self, pipeline: Pipeline, mapper: Mapper, live: bool = False) -> None:
        """live: whether frames are of now, which dates the map's objects by `clock`."""
        self.pipeline, self.mapper = pipeline, mapper
        self.clock: Callable[[float], ClockReading] = partial(stream_clock, live)

    def step(self, frame: Frame, faults: Sequence[Fault] = ()) -> StepResult:
        """One frame in: its observations, the robot's motion, and the update of the map. faults: outside of the step,
        since the previous one."""
        if frame.index == 0:
            self.mapper.memory.identify(repr(frame.stamp_s).encode() + frame.image.tobytes())
        self.mapper.memory.clock.note(frame.stamp_s, self.clock(frame.stamp_s))
        frame = self.pipeline.marked(frame)
        observed = self.pipeline.step(frame)
        return StepResult.of(frame, observed, self.mapper.step(observed), faults, self.pipeline.pictured)

    def finish(self) -> StepResult | None:
        """After the last frame: the map's update by the boxes still due from an asynchronous detector; None where it
        owes none."""
        if (newest := self.pipeline.finish()) is None:
            return None
        return StepResult.of(*newest, self.mapper.step(newest[1]), pictured=self.pipeline.pictured)

    def step_blind(self, stamp_s: float, reason: Fault) -> None:
        """A step without a frame: the motion by sources that need no picture. The map stays unchanged."""
        self.mapper.step_blind(self.pipeline.odometry.step_blind(stamp_s, reason))

    def objects(self) -> list[MapObject]:
        """The objects of the map."""
        return self.mapper.objects()


@dataclass(frozen=True, slots=True)
class SlamOptions:
    """Options of a run, as opposed to tuned parameters. The defaults are those of `edgemap run`.

    odometry: a SPEC. wheels, imu: whether the source's are used. clustering: default or paper. forgets: whether objects
    that have disappeared are removed from the map. classes: those that go on the map, the bundle's where None.
    confidence: minimum score of a box, the bundle's where None. guessed_height:
    standard deviation of the mount's height as a share, where it is a guess: the map is saved with the lengths of its
    estimate; 0 where it was stated, or the odometry's lengths do not depend on it. pose_frame: as of `read_given`.
    """

    odometry: str = "hybrid"
    wheels: bool = True
    imu: bool = True
    clustering: str = "default"
    loop_closure: bool = True
    forgets: bool = False
    classes: Collection[str] | None = None
    confidence: float | None = None
    guessed_height: float = 0.0
    pose_frame: str | None = None

    @property
    def closes_loops(self) -> bool:
        """Whether loops are closed: not with recorded poses."""
        recorded = self.odometry == "truth" or is_pose_file(self.odometry) or is_tf(self.odometry)
        return self.loop_closure and not recorded


def build_slam(
    camera: Camera, bundle: Bundle, floor: FloorCamera, options: SlamOptions | None = None, config: Config | None = None
) -> SemanticSlam:
    """An empty map and all that fills it. floor: the camera's lens and mount. Raises OdometryError."""
    options, config = options or SlamOptions(), config or Config()
    wheels, rules, health, tilt = options.wheels, config.odometry, config.health, config.attitude.check.tilt
    if options.odometry == "paper":  # reads the detector's own map
        bundle = replace(bundle, companion=None)
    moving = bundle.companion or bundle
    odometry = open_odometry(options.odometry, moving, camera, floor, wheels, rules, health, tilt, options.pose_frame)
    given = odometry.attitude if isinstance(odometry, JudgedOdometry) else None
    attitude = open_attitude(options.odometry, camera, floor, options.imu, config.attitude, health, rules, given)
    pipeline = Pipeline(
        bundle,
        floor,
        odometry,
        config=config,
        mapped=options.classes,
        attitude=attitude,
        confidence=options.confidence,
        guessed_height=options.guessed_height,
    )
    mapper = Mapper(
        config=config,
        paper=PaperMap() if options.clustering == "paper" else None,
        closes_loops=options.closes_loops,
        forgetter=Forgetter(floor, config.forgetting) if options.forgets else None,
    )
    return SemanticSlam(pipeline, mapper, camera.info.live)
