"""The front end in one method: `Pipeline.step` takes a frame and gives what is in view and how the robot moved."""

from __future__ import annotations

from dataclasses import replace

from edgemap.geometry.camera.floor import FloorCamera
from edgemap.geometry.observations.sighting import FloorRule, sightings_of
from edgemap.runtime.bundle import Bundle
from edgemap.runtime.decode import Decoder
from edgemap.runtime.errors import CameraError
from edgemap.runtime.frame import Frame
from edgemap.runtime.frame_observations import FrameObservations
from edgemap.runtime.odometry.protocol import Odometry
from edgemap.runtime.preprocess import Preprocessor
from edgemap.runtime.timing import Stopwatch


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
        confidence: float | None = None,
    ) -> None:
        self.camera, self.odometry = camera, odometry
        rule = rule or FloorRule()
        self.rule = replace(
            rule,
            mapped=bundle.mapped if rule.mapped is None else rule.mapped,
            full_weight_score=bundle.full_weight_score(confidence),
        )
        self._backbone = bundle.backbone
        self._input_name = bundle.manifest.detector.input.name
        self._preprocess = Preprocessor(bundle.manifest.detector.input)
        min_score = bundle.manifest.confidence if confidence is None else confidence
        self._decode = Decoder(bundle.manifest.detector, min_score)
        self._watch = Stopwatch()

    def step(self, frame: Frame) -> FrameObservations:
        """One frame in: boxes, positions on the floor, own motion. Raises CameraError for a frame of another size."""
        stage = self._begin(frame)
        tensor, placement = self._preprocess(frame.image)
        stage("preprocess")
        outputs = self._backbone.run({self._input_name: tensor})
        stage("backbone")
        detections = self._decode(outputs, placement)
        stage("decode")
        sightings = sightings_of(detections, self.camera, self.rule, frame.index, frame.stamp_s)
        stage("floor")
        motion = self.odometry.step(frame, outputs)
        stage("odometry")
        return FrameObservations(frame.index, frame.stamp_s, detections, sightings, motion, self._watch.stages_ms)

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
