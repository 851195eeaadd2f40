"""The whole product in one method: `Pipeline.step` takes a frame and updates pose and map."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from edgemap.geometry.camera.floor import FloorCamera
from edgemap.geometry.objects.floor_map import FloorMap
from edgemap.geometry.objects.forgetting import Forgetter, NoForgetting
from edgemap.geometry.objects.map_object import MapObject, ObjectMap
from edgemap.geometry.observations.detections import Detections
from edgemap.geometry.observations.sighting import FloorRule, PlacedSighting, Sighting, sightings_of
from edgemap.geometry.se2 import SE2, compose_covariance
from edgemap.runtime.bundle import Bundle
from edgemap.runtime.decode import Decoder
from edgemap.runtime.errors import CameraError
from edgemap.runtime.frame import Frame
from edgemap.runtime.loop_closing import LoopCorrection, NoLoopClosure
from edgemap.runtime.odometry.protocol import Motion, Odometry
from edgemap.runtime.preprocess import Preprocessor
from edgemap.runtime.timing import Stopwatch

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class StepResult:
    """All that one step found; sinks read it and nothing else.

    object_ids: one per sighting. merged: ids of the whole run that are no more, to the id that they became part of.
    relocated: in the one result from which on everything is in a saved map's frame, that frame's view of the frame
    before (`pose_map_start`): what came earlier must be moved by it. corrected: in a result whose pose and map were put
    right by things seen again; what came earlier moves with its `past`.
    """

    frame: Frame
    detections: Detections
    sightings: list[PlacedSighting]
    object_ids: list[str]
    merged: dict[str, str]
    motion: Motion
    pose_map_base: SE2
    pose_covariance: Array
    stages_ms: dict[str, float]
    relocated: SE2 | None = None
    corrected: LoopCorrection | None = None


class Pipeline:
    """One camera's frames to a map. Depends on the frames and their stamps only, never on wall time."""

    def __init__(
        self,
        bundle: Bundle,
        camera: FloorCamera,
        odometry: Odometry,
        object_map: ObjectMap,
        *,
        rule: FloorRule | None = None,
        confidence: float | None = None,
        forgetter: Forgetter | NoForgetting | None = None,
        loop_closer: NoLoopClosure | None = None,
    ) -> None:
        self.camera, self.odometry, self.map = camera, odometry, object_map
        self.rule = rule or FloorRule(mapped=bundle.mapped, full_weight_score=bundle.full_weight_score(confidence))
        self.forgetter = forgetter or NoForgetting()
        # Only the default map can move with a corrected way.
        self.loop_closer = loop_closer if loop_closer and isinstance(object_map, FloorMap) else NoLoopClosure()
        self._backbone = bundle.backbone
        self._input_name = bundle.manifest.detector.input.name
        self._preprocess = Preprocessor(bundle.manifest.detector.input)
        least = bundle.manifest.confidence if confidence is None else confidence
        self._decode = Decoder(bundle.manifest.detector, least)
        self._watch = Stopwatch()
        self.pose_map_base, self.pose_covariance = SE2(), np.zeros((3, 3))
        self._started = False

    def step(self, frame: Frame) -> StepResult:
        """One frame in: boxes, floor positions, own motion, map. Raises CameraError for a frame of another size."""
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
        self._advance(motion)
        stage("odometry")
        corrected = self._correct(motion, sightings, frame.stamp_s)
        stage("correct")
        placed = self._placed(sightings)
        object_ids = self.map.update(placed)
        self.forgetter.look(self.map, detections, self.pose_map_base, object_ids)
        stage("map")
        return StepResult(
            frame=frame,
            detections=detections,
            sightings=placed,
            object_ids=object_ids,
            merged=self.map.merged,
            motion=motion,
            pose_map_base=self.pose_map_base,
            pose_covariance=self.pose_covariance,
            stages_ms=self._watch.stages_ms,
            corrected=corrected,
        )

    def objects(self) -> list[MapObject]:
        """The map as it stands."""
        return self.map.objects()

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

    def _advance(self, motion: Motion) -> None:
        """Carry the pose on; the first frame's pose is the map's origin, known exactly."""
        if self._started:
            self.pose_covariance = compose_covariance(
                self.pose_map_base, self.pose_covariance, motion.motion, motion.covariance
            )
            self.pose_map_base = self.pose_map_base @ motion.motion
        self._started = True

    def _correct(self, motion: Motion, sightings: list[Sighting], stamp_s: float) -> LoopCorrection | None:
        """Where things seen again tell how far the pose has drifted, pose and map move."""
        pose, covariance = self.pose_map_base, self.pose_covariance
        corrected = self.loop_closer.look(pose, covariance, motion, sightings, stamp_s)
        if corrected is not None and isinstance(self.map, FloorMap):
            self.pose_map_base, self.pose_covariance = corrected.pose_map_base, corrected.pose_covariance
            self.map.moved(corrected.things)
        return corrected

    def _placed(self, sightings: list[Sighting]) -> list[PlacedSighting]:
        pose, covariance, things = self.pose_map_base, self.pose_covariance, self.loop_closer.things
        return [sighting.placed(pose, covariance, thing) for sighting, thing in zip(sightings, things, strict=True)]
