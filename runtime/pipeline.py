"""The front end in one method: `Pipeline.step` takes a frame and gives what is in view and how the robot moved."""

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from edgemap.geometry.camera.floor import FloorCamera
from edgemap.geometry.observations.detections import Detections
from edgemap.geometry.observations.movers import mover_boxes
from edgemap.geometry.observations.sighting import FloorRule, sightings_of
from edgemap.geometry.se2 import SE2
from edgemap.runtime.attitude.protocol import AttitudeSource
from edgemap.runtime.attitude.sources import MountAttitude
from edgemap.runtime.bundle import Bundle
from edgemap.runtime.decode import Decoder
from edgemap.runtime.errors import CameraError
from edgemap.runtime.frame import Frame
from edgemap.runtime.frame_observations import FrameObservations
from edgemap.runtime.health import HealthMonitor, HealthRule, PictureHealth
from edgemap.runtime.height_check import HeightCheck, HeightRule
from edgemap.runtime.network import Tensors
from edgemap.runtime.odometry.protocol import Motion, Odometry, StartsAhead
from edgemap.runtime.preprocess import Preprocessor
from edgemap.runtime.rest import RestMonitor, RestRule
from edgemap.runtime.timing import Stopwatch

# A picture that did not change shows what is in view as long as the robot has moved by less since it was new.
REST_M, REST_RAD = 0.02, math.radians(0.5)


class Pipeline:
    """One camera's frames to observations. Depends on the frames and their stamps only, never on wall time.

    rule: its mapped classes are the bundle's where it names none; what counts fully is the bundle's or confidence's.
    """

    def __init__(
        self,
        bundle: Bundle,
        camera: FloorCamera,
        odometry: Odometry,
        *,
        rule: FloorRule | None = None,
        attitude: AttitudeSource | None = None,
        confidence: float | None = None,
        health: HealthRule | None = None,
        rest: RestRule | None = None,
        height: HeightRule | None = None,
    ) -> None:
        self.camera, self.odometry = camera, odometry
        self._begin_odometry = odometry.begin if isinstance(odometry, StartsAhead) else lambda *_: None
        self.attitude = attitude or MountAttitude(camera.mount)
        rule = rule or FloorRule()
        self.rule = replace(
            rule,
            mapped=bundle.mapped if rule.mapped is None else rule.mapped,
            full_weight_score=bundle.full_weight_score(confidence),
        )
        fitted = bundle.for_pictures(camera.intrinsics.width, camera.intrinsics.height, odometry.needs_features)
        self._backbone = fitted.backbone
        self._input_name = fitted.detector.input.name
        self._preprocess = Preprocessor(fitted.detector.input)
        min_score = bundle.manifest.confidence if confidence is None else confidence
        self._decode = Decoder(fitted.detector, min_score, one_name=True)
        self._names = bundle.names
        self._found = Detections.none(bundle.names)  # in the last picture that was searched
        self._health, self._rest = HealthMonitor(health), RestMonitor(rest)
        self._height = HeightCheck(camera.mount, height)
        self._since_seen = SE2()
        self._moved: tuple[SE2, NDArray[np.float64]] | None = None  # over the last frame, for the attitude
        self._watch = Stopwatch()

    def step(self, frame: Frame) -> FrameObservations:
        """One frame in: boxes, positions on the floor, own motion. Raises CameraError for a frame of another size."""
        stage = self._begin(frame)
        health = self._health.judge(frame)
        stage("health")
        attitude = self.attitude.step(replace(frame, moved=self._moved))
        frame, camera = replace(frame, attitude=attitude, covered=health.covered), self.camera.at(attitude)
        stage("attitude")
        at_rest = self._rest.judge(frame, health, self.odometry.still(frame.stamp_s, attitude), self._moved)
        if self._rest.frozen_since_s is not None and not health.blind:
            health = self._health.unmoved(self._rest.frozen_since_s, frame.stamp_s)
        stage("rest")
        if at_rest:
            return self._stand(frame, health, camera)
        motion = self._move_blind(frame, health) if health.blind else None
        if not self._searches(frame, health):
            motion = motion or self._move(frame, {})
            return self._unsearched(frame, Detections.none(self._names), motion, health, self._rotated(camera, motion))
        tensor, placement = self._preprocess(frame.image)
        stage("preprocess")
        outputs = self._backbone.run({self._input_name: tensor})
        stage("backbone")
        if motion is None:
            self._begin_odometry(frame, outputs)  # its network runs while this thread decodes
        detections = self._found = self._decode(outputs, placement)
        stage("decode")
        motion = motion or self._move(frame, outputs)
        camera = self._rotated(camera, motion)
        sightings = sightings_of(detections, camera, self.rule, frame.index, frame.stamp_s, frame.depth)
        stage("floor")
        fault = self._height.judge(frame, camera, detections, motion)
        stage("height")
        stages_ms = self._watch.stages_ms
        return FrameObservations(
            frame.index, frame.stamp_s, detections, sightings, motion, stages_ms, health, camera, mount_fault=fault
        )

    def _stand(self, frame: Frame, health: PictureHealth, camera: FloorCamera) -> FrameObservations:
        """No network runs and nothing is counted again; the first frame that differs is compared with the last one."""
        motion = self.odometry.rest(frame.stamp_s)
        self._moved = motion.moved()
        self._watch.stage("odometry")
        camera = self._rotated(camera, motion)
        return replace(self._unsearched(frame, self._found, motion, health, camera), at_rest=True)

    def _rotated(self, camera: FloorCamera, motion: Motion) -> FloorCamera:
        """The frame's camera, where its attitude was predicted as the odometry saw it rotate."""
        predicted, told = camera.attitude, self.attitude.rotated(motion.rotation)
        if predicted is not None and predicted.predicted:
            camera = self.camera.at(replace(told, fault=predicted.fault))
        self._watch.stage("attitude")
        return camera

    def _searches(self, frame: Frame, health: PictureHealth) -> bool:
        """Whether the backbone runs: not on what shows nothing new of where the robot is, nor where a budget forbids it
        and the odometry can do without."""
        sees = not health.blind or (health.stale and self._at_rest())
        return sees and (frame.search or self.odometry.needs_features)

    def _unsearched(
        self, frame: Frame, boxes: Detections, motion: Motion, health: PictureHealth, camera: FloorCamera
    ) -> FrameObservations:
        """A frame that adds no observation to the map."""
        stages_ms = self._watch.stages_ms
        return FrameObservations(
            frame.index, frame.stamp_s, boxes, [], motion, stages_ms, health, camera, searched=False
        )

    def _move(self, frame: Frame, features: Tensors) -> Motion:
        """The odometry's step, with the backbone's outputs where it ran."""
        self._since_seen = SE2()
        frame = replace(frame, movers=mover_boxes(self._found))
        motion = self.odometry.step(frame, features).checked(self.odometry.name)
        self._moved = motion.moved()
        self._watch.stage("odometry")
        return motion

    def _move_blind(self, frame: Frame, health: PictureHealth) -> Motion:
        """The odometry goes on with what needs no picture."""
        motion = self.odometry.step_blind(frame.stamp_s, health.reason, frame.attitude).checked(self.odometry.name)
        self._since_seen, self._moved = self._since_seen @ motion.motion, motion.moved()
        self._watch.stage("odometry")
        return motion

    def _at_rest(self) -> bool:
        """Whether the robot stands where the last picture that could be trusted was taken."""
        since = self._since_seen
        return math.hypot(since.x_m, since.y_m) < REST_M and abs(since.yaw_rad) < REST_RAD

    def _begin(self, frame: Frame):
        height, width = frame.image.shape[:2]
        expected = self.camera.intrinsics
        if (width, height) != (expected.width, expected.height):
            raise CameraError(
                f"frame {frame.index} {frame.name} is {width}x{height} px, "
                f"the intrinsics are for {expected.width}x{expected.height}"
            )
        self._watch.start()
        return self._watch.stage
