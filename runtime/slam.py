"""One frame through front end and back end: the result that every sink reads."""

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Self

import numpy as np
from numpy.typing import NDArray

from edgemap.geometry.objects.map_object import MapObject
from edgemap.geometry.observations.detections import Detections
from edgemap.geometry.se2 import SE2
from edgemap.runtime.cameras.fault import CameraFault
from edgemap.runtime.frame import Frame
from edgemap.runtime.frame_observations import FrameObservations
from edgemap.runtime.health import PictureHealth
from edgemap.runtime.mapper import Mapper, MapUpdate
from edgemap.runtime.odometry.protocol import Motion
from edgemap.runtime.pipeline import Pipeline


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class StepResult(MapUpdate):
    """All that one step found: the picture, what the front end observed in it, and what the back end made of that.

    stages_ms: of every stage of the step, in order. faults: of delivery, since the result before.
    """

    frame: Frame
    observed: FrameObservations
    faults: tuple[CameraFault, ...] = ()

    @classmethod
    def of(
        cls, frame: Frame, observed: FrameObservations, update: MapUpdate, faults: Sequence[CameraFault] = ()
    ) -> Self:
        """Both ends' findings as one."""
        values = {item.name: getattr(update, item.name) for item in fields(update)}
        values["stages_ms"] = observed.stages_ms | update.stages_ms
        return cls(**values, frame=frame, observed=observed, faults=tuple(faults))

    def _repr_png_(self) -> bytes:
        """In a notebook: the picture with all boxes, those on the floor with their distance."""
        from edgemap.runtime.notebook import png
        from edgemap.runtime.overlay import draw_detections

        sightings = [placed.sighting for placed in self.sightings]
        return png(draw_detections(self.frame.image, self.detections, sightings))

    @property
    def detections(self) -> Detections:
        """All boxes of the frame."""
        return self.observed.detections

    @property
    def motion(self) -> Motion:
        """Of the base since the frame before."""
        return self.observed.motion

    @property
    def health(self) -> PictureHealth:
        """Of the picture; a blind one gives no observations."""
        return self.observed.health

    @property
    def object_of_box(self) -> dict[int, str]:
        """The object of each box that stands on the floor, by the box's row in `detections`."""
        return {
            placed.sighting.detection: identity
            for placed, identity in zip(self.sightings, self.object_ids, strict=True)
        }


class SemanticSlam:
    """Front end and back end behind one method."""

    def __init__(self, pipeline: Pipeline, mapper: Mapper) -> None:
        self.pipeline, self.mapper = pipeline, mapper

    def step(self, frame: Frame, faults: Sequence[CameraFault] = ()) -> StepResult:
        """One frame in: what is in view, the robot's motion, and what the map makes of both."""
        observed = self.pipeline.step(frame)
        return StepResult.of(frame, observed, self.mapper.step(observed), faults)

    def step_blind(self, stamp_s: float, reason: str) -> tuple[SE2, NDArray[np.float64]]:
        """No frame: pose and covariance by what needs no picture. The map stays."""
        return self.mapper.step_blind(self.pipeline.odometry.step_blind(stamp_s, reason))

    def objects(self) -> list[MapObject]:
        """The map as it stands."""
        return self.mapper.objects()
