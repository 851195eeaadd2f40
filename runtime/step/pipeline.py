"""The front end in one method: `Pipeline.step` takes a frame and returns its observations and the robot's motion."""

import math
from collections.abc import Collection
from dataclasses import replace

from edgemap.geometry.camera.attitude import Attitude
from edgemap.geometry.camera.depth_points import SparseDepth
from edgemap.geometry.camera.floor import FloorCamera
from edgemap.geometry.observations.detections import Detections, mover_boxes
from edgemap.geometry.observations.floor_mask import FloorMask
from edgemap.geometry.observations.sighting import is_worktop, sightings_of
from edgemap.geometry.se2 import SE2
from edgemap.runtime.frames.errors import CameraError
from edgemap.runtime.frames.frame import Frame
from edgemap.runtime.frames.timing import Stopwatch
from edgemap.runtime.motion.attitude.source import AttitudeSource, Moved
from edgemap.runtime.motion.depth_scale import DepthScale
from edgemap.runtime.motion.health import HealthMonitor, PictureHealth
from edgemap.runtime.motion.height_check import HeightCheck
from edgemap.runtime.motion.odometry.protocol import FramePrior, Motion, Odometry, no_motion
from edgemap.runtime.motion.rest import RestMonitor
from edgemap.runtime.network.bundle import Bundle
from edgemap.runtime.network.decode import Decoder, Detector, DetectorBeside
from edgemap.runtime.network.network import Tensors
from edgemap.runtime.network.preprocess import floor_mask
from edgemap.runtime.step.config import Config
from edgemap.runtime.step.frame_observations import FrameObservations

# A repeated picture is still searched while the robot has moved by less since it was new.
SAME_VIEW_M, SAME_VIEW_RAD = 0.02, math.radians(0.5)

_Observed = tuple[Frame, FrameObservations]


class Pipeline:
    """Health, prediction, backbone, decoding, motion, observations: one camera's frames, in order.

    It depends on the frames and their stamps only, never on wall time. A detector with a companion runs in a separate
    thread: its boxes come with the next picture that is searched, as those of the one before. mapped: labels, the
    bundle's where None. confidence: lowest score, the bundle's where None; the score of full weight follows it.
    guessed_height: standard deviation of the mount's height as a share, where it is a guess; 0 where it was stated.
    """

    def __init__(
        self,
        bundle: Bundle,
        camera: FloorCamera,
        odometry: Odometry,
        *,
        config: Config | None = None,
        mapped: Collection[str] | None = None,
        attitude: AttitudeSource | None = None,
        confidence: float | None = None,
        guessed_height: float = 0.0,
    ) -> None:
        config = config or Config()
        self.camera, self.odometry, self.rule = camera, odometry, config.floor
        self.attitude = attitude or AttitudeSource.of_mount(camera.mount)
        self.evidence = bundle.evidence(mapped, confidence)
        sensing = fitted = bundle.companion or bundle
        if not odometry.needs_features:  # of the whole input
            fitted = sensing.for_pictures(camera.intrinsics.width, camera.intrinsics.height)
        self._floor_output = fitted.detector.floor if camera.mount.platform.in_room else None
        min_score = bundle.manifest.confidence if confidence is None else confidence
        self._decode = Decoder((fitted if sensing is bundle else bundle).detector, min_score, one_name=True)
        self._network = Detector(fitted, self._decode)
        self._beside = None if sensing is bundle else DetectorBeside(Detector(bundle, self._decode))
        self._paced = bundle.paced
        self._waiting: _Observed | None = None  # for its boxes
        self._newest: _Observed | None = None
        self.pictured: Frame | None = None  # that the boxes of the last step are of
        self._names = bundle.names
        self._detections = Detections.none(bundle.names)  # of the last picture that was searched
        self._floor: FloorMask | None = None  # of that picture
        self._health, self._rest = HealthMonitor(config.health), RestMonitor(config.rest, config.health)
        self._height = HeightCheck(camera.mount, config.height, guessed_height)
        self._depth = DepthScale(camera.mount.height_m, config.height.wrong_share)
        self._since_view = SE2()  # motion since the last picture with information
        self._moved: Moved | None = None  # in the step before
        self._watch = Stopwatch()

    def marked(self, frame: Frame) -> Frame:
        """The frame, not to be searched where it comes at a camera's pace and the asynchronous detector is busy."""
        busy = frame.search and self._paced and self._beside is not None and self._beside.busy
        return replace(frame, search=False) if busy else frame

    def step(self, frame: Frame) -> FrameObservations:
        """A frame's motion, and boxes and positions on the floor: of it, or of the picture before that was searched.
        Raises CameraError for a frame of another size."""
        self._check_size(frame)
        self._watch.start()
        frame = replace(frame, depth=None) if self._depth.wrong else frame
        stage = self._watch.stage
        with stage("health"):
            health = self._health.judge(frame)
        with stage("attitude"):
            attitude = self.attitude.predict(frame, self._moved)
        with stage("rest"):
            still = self.odometry.still(frame.stamp_s, attitude)
            at_rest, health = self._rest.judge(frame, health, still, self._moved, attitude.rotation)
        motion = self._motion_without_picture(frame.stamp_s, health, attitude, at_rest)
        viewed = not at_rest and self._is_informative(health)
        searched = viewed and frame.search
        sensed = searched or (viewed and (self.odometry.needs_features or self._beside is not None))
        outputs = self._sense(frame) if sensed else {}
        motion = motion or self._motion_by_picture(frame, outputs, attitude, health)
        with stage("attitude"):
            camera = self.camera.at(self.attitude.update(motion.rotation))
        depth = frame.depth if sensed and self._depth.fit else None
        observed = FrameObservations(
            index=frame.index,
            stamp_s=frame.stamp_s,
            detections=self._detections if at_rest else Detections.none(self._names),
            sightings=[],
            motion=motion,
            stages_ms=self._watch.stages_ms,
            health=health,
            camera=camera,
            searched=False,
            at_rest=at_rest,
            floor=self._floor if sensed else None,
            depth=None if depth is None else SparseDepth.of(depth),
        )
        found = (frame, observed) if searched else None
        if searched and self._beside is not None:
            found, self._waiting = self._waiting, found
        self.pictured, height = frame, self._height
        if found is not None:
            observed = self._with_boxes(observed, *found)
        every = dict.fromkeys((health.fault, *self.attitude.faults, *observed.faults, *motion.faults))
        faults = tuple(fault for fault in every if fault is not None)
        observed = replace(observed, faults=faults, height_estimate=height.estimate, scale=height.scale)
        self._newest = frame, observed
        return observed

    def finish(self) -> tuple[Frame, FrameObservations] | None:
        """The last frame once more, without a motion and with the boxes still due from the asynchronous detector, for
        which it waits; None where it owes none."""
        found, self._waiting = self._waiting, None
        if found is None or self._newest is None or self._beside is None:
            return None
        self._detections = self._beside.last() or self._detections
        frame, observed = self._newest
        return frame, replace(self._with_boxes(observed, *found), motion=no_motion(), faults=(), stages_ms={})

    def _with_boxes(self, observed: FrameObservations, frame: Frame, seen: FrameObservations) -> FrameObservations:
        """This frame's observations with the newest boxes, those of the picture `frame` with its observations `seen`,
        and the faults of depth and height."""
        boxes, stage = self._detections, self._watch.stage
        camera, floor, self.pictured = seen.camera or self.camera, seen.floor, frame
        with stage("floor"):
            depth = frame.depth if self._depth.fit else None
            sightings = sightings_of(boxes, camera, self.rule, frame.index, frame.stamp_s, depth, floor, self.evidence)
        with stage("height"):
            depths = None if frame.depth is None else SparseDepth.of(frame.depth)
            by_depth = self._depth.judge(depths, floor, camera, self._height.estimate)
            by_height = self._height.judge(frame.stamp_s, camera, boxes, seen.motion, depths is not None)
        return replace(
            observed, detections=boxes, sightings=sightings, searched=True, worktop=is_worktop(floor, boxes),
            before=None if seen is observed else seen, faults=tuple(filter(None, (by_depth, by_height))),
        )  # fmt: skip

    def _sense(self, frame: Frame) -> Tensors:
        """The backbone's outputs. Keeps the newest boxes, and the floor mask."""
        stage = self._watch.stage
        outputs, placement = self._network.raw(frame.image, stage)
        with stage("decode" if self._beside is None else "detector"):
            if self._beside is None:
                self._detections = self._decode(outputs, placement)
            elif frame.search and (boxes := self._beside(frame.image)) is not None:
                self._detections = boxes
        with stage("floor_mask"):
            self._floor = floor_mask(outputs, placement, self._floor_output)
        return outputs

    def _motion_without_picture(
        self, stamp_s: float, health: PictureHealth, attitude: Attitude, at_rest: bool
    ) -> Motion | None:
        """The motion of a robot at rest, or up to a blind picture; None where this picture measures it."""
        if not at_rest and health.blindness is None:
            return None
        with self._watch.stage("odometry"):
            if at_rest or health.blindness is None:
                motion = self.odometry.rest(stamp_s)
            else:
                motion = self.odometry.step_blind(stamp_s, health.blindness, attitude).checked(self.odometry.name)
                self._since_view = self._since_view @ motion.motion
            self._moved = motion.moved()
        return motion

    def _motion_by_picture(self, frame: Frame, outputs: Tensors, attitude: Attitude, health: PictureHealth) -> Motion:
        """The odometry's step. outputs: the backbone's, empty where it did not run."""
        with self._watch.stage("odometry"):
            prior = FramePrior(attitude, health.covered, movers=mover_boxes(self._detections), floor=self._floor)
            motion = self.odometry.step(frame, outputs, prior).checked(self.odometry.name)
            self._since_view, self._moved = SE2(), motion.moved()
        return motion

    def _is_informative(self, health: PictureHealth) -> bool:
        """Whether networks run: not on a blind picture, but on a repeated one of the same view."""
        since = self._since_view
        same_view = math.hypot(since.x_m, since.y_m) < SAME_VIEW_M and abs(since.yaw_rad) < SAME_VIEW_RAD
        return not health.blind or (health.stale and same_view)

    def _check_size(self, frame: Frame) -> None:
        height, width = frame.image.shape[:2]
        expected = self.camera.intrinsics
        if (width, height) != (expected.width, expected.height):
            raise CameraError(
                f"frame {frame.index} {frame.name} is {width}x{height} px, "
                f"the intrinsics are for {expected.width}x{expected.height}"
            )
