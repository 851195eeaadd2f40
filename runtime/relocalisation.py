"""Going on with a saved map: from a known start pose, or from wherever its objects say that the robot is."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from edgemap.geometry.objects.floor_map import FloorMap
from edgemap.geometry.objects.map_object import MapObject, ObjectMap
from edgemap.geometry.objects.merge import merge_maps
from edgemap.geometry.registration.alignment import Alignment, AlignmentError, align
from edgemap.geometry.se2 import SE2, compose_covariance
from edgemap.runtime.frame import Frame
from edgemap.runtime.loop import Steps
from edgemap.runtime.loop_closing import NoLoopClosure
from edgemap.runtime.pipeline import StepResult

START_SIGMAS = (0.10, 0.10, math.radians(3.0))  # m, m, rad: how well a person knows where the robot stands
LOOK_AGAIN = 50  # frames after which the same number of objects is worth another try


class Mapper(Steps, Protocol):
    """What can be moved into another map: a Pipeline."""

    map: ObjectMap
    pose_map_base: SE2
    pose_covariance: NDArray[np.float64]
    loop_closer: NoLoopClosure


M = TypeVar("M", bound=Mapper)


def start_in(pipeline: M, saved: Sequence[MapObject], start: SE2) -> M:
    """The pipeline, standing at `start` in the saved map, which it goes on with from its first frame."""
    pipeline.map = FloorMap.continued(saved)
    pipeline.pose_map_base, pipeline.pose_covariance = start, np.diag(np.square(START_SIGMAS))
    pipeline.loop_closer.begin_in(saved)
    return pipeline


class Relocaliser:
    """A pipeline that makes a map of its own until its objects show where in the saved map it is, and then goes on
    with that one: pose, map and sightings are in the saved map's frame from that step's result on.

    alignment: None until then. reason: why not yet. New objects are numbered after the saved ones, so an id means one
    thing throughout; StepResult.merged says which of them turned out to be saved ones.
    """

    def __init__(self, pipeline: Mapper, saved: Sequence[MapObject]) -> None:
        self.pipeline = pipeline
        self.alignment: Alignment | None = None
        self.reason = "no object seen yet"
        self._saved = list(saved)
        self._own = FloorMap.after(saved)
        self._seen, self._frames_since = 0, 0
        pipeline.map = self._own

    def step(self, frame: Frame) -> StepResult:
        """One frame through the pipeline, and a look at where that may be while it is not known."""
        result = self.pipeline.step(frame)
        if self.alignment is None and self._worth_a_look():
            try:
                self.alignment = align(self._saved, self._own.objects())
            except AlignmentError as error:
                self.reason = str(error)
            else:
                return self._moved_over(result, self.alignment)
        return result

    def objects(self) -> list[MapObject]:
        """The map as it stands."""
        return self.pipeline.objects()

    def _worth_a_look(self) -> bool:
        """When more objects are known than at the last look, or the same ones better."""
        count = len(self._own.objects())
        self._frames_since += 1
        if count <= self._seen and self._frames_since < LOOK_AGAIN:
            return False
        self._seen, self._frames_since = count, 0
        return count > 0

    def _moved_over(self, result: StepResult, alignment: Alignment) -> StepResult:
        """Both maps become one, and the robot and this frame's sightings move into the saved one's frame."""
        pipeline, (merged, became) = self.pipeline, merge_maps(self._saved, self._own.objects(), alignment)
        pipeline.map = FloorMap.continued(merged, before=self._own, merged=became)
        pipeline.pose_covariance = compose_covariance(
            alignment.pose_a_b, alignment.covariance, pipeline.pose_map_base, pipeline.pose_covariance
        )
        pipeline.pose_map_base = alignment.pose_a_b @ pipeline.pose_map_base
        pipeline.loop_closer.begin_in(merged)
        pose, covariance = pipeline.pose_map_base, pipeline.pose_covariance
        return replace(
            result,
            sightings=[placed.sighting.placed(pose, covariance) for placed in result.sightings],
            object_ids=[became.get(identity, identity) for identity in result.object_ids],
            merged=pipeline.map.merged,
            pose_map_base=pose,
            pose_covariance=covariance,
            relocated=alignment.pose_a_b,
        )
