"""One frame through front end and back end: the result that every sink reads."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from edgemap.geometry.objects.map_object import MapObject
from edgemap.geometry.observations.detections import Detections
from edgemap.geometry.observations.sighting import PlacedSighting
from edgemap.geometry.se2 import SE2
from edgemap.runtime.cameras.fault import CameraFault
from edgemap.runtime.frame import Frame
from edgemap.runtime.frame_observations import FrameObservations
from edgemap.runtime.health import PictureHealth
from edgemap.runtime.loop_closing import LoopCorrection
from edgemap.runtime.mapper import Mapper, MapUpdate
from edgemap.runtime.odometry.protocol import Motion
from edgemap.runtime.pipeline import Pipeline
from edgemap.runtime.pose_journal import PoseJournal


@dataclass(frozen=True, slots=True, eq=False)
class StepResult:
    """All that one step found: the picture, what the front end observed in it, and what the back end made of that.

    faults: of delivery, since the result before.
    """

    frame: Frame
    observed: FrameObservations
    update: MapUpdate
    faults: tuple[CameraFault, ...] = ()

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
    def sightings(self) -> list[PlacedSighting]:
        """The boxes that stand on the floor, in the map."""
        return self.update.sightings

    @property
    def object_ids(self) -> list[str]:
        """The object of each sighting."""
        return self.update.object_ids

    @property
    def object_of_box(self) -> dict[int, str]:
        """The object of each box that stands on the floor, by the box's row in `detections`."""
        return {
            placed.sighting.detection: identity
            for placed, identity in zip(self.sightings, self.object_ids, strict=True)
        }

    @property
    def merged(self) -> dict[str, str]:
        """Ids that are no more, to the id that they became part of."""
        return self.update.merged

    @property
    def pose_map_base(self) -> SE2:
        """The base in the map frame."""
        return self.update.pose_map_base

    @property
    def pose_covariance(self) -> NDArray[np.float64]:
        """(3, 3) of x, y, yaw: m, m, rad."""
        return self.update.pose_covariance

    @property
    def pose_odom_base(self) -> SE2:
        """The base in the odom frame (REP-105): by odometry alone, continuous."""
        return self.update.pose_odom_base

    @property
    def odom_covariance(self) -> NDArray[np.float64]:
        """(3, 3) of x, y, yaw in the odom frame: m, m, rad; grows without bound."""
        return self.update.odom_covariance

    @property
    def trajectory(self) -> PoseJournal:
        """All poses so far, as known now."""
        return self.update.trajectory

    @property
    def correction(self) -> LoopCorrection | None:
        """The loop closure of this step."""
        return self.update.correction

    @property
    def relocated(self) -> SE2 | None:
        """Where the run's frame lies in the saved map's, in the one step that finds it."""
        return self.update.relocated

    @property
    def stages_ms(self) -> dict[str, float]:
        """Time of every stage, in order."""
        return self.observed.stages_ms | self.update.stages_ms


class SemanticSlam:
    """Front end and back end behind one method."""

    def __init__(self, pipeline: Pipeline, mapper: Mapper) -> None:
        self.pipeline, self.mapper = pipeline, mapper

    def step(self, frame: Frame, faults: Sequence[CameraFault] = ()) -> StepResult:
        """One frame in: what is in view, the robot's motion, and what the map makes of both."""
        observed = self.pipeline.step(frame)
        return StepResult(frame, observed, self.mapper.step(observed), tuple(faults))

    def step_blind(self, stamp_s: float, reason: str) -> tuple[SE2, NDArray[np.float64]]:
        """No frame: pose and covariance by what needs no picture. The map stays."""
        return self.mapper.step_blind(self.pipeline.odometry.step_blind(stamp_s, reason))

    def objects(self) -> list[MapObject]:
        """The map as it stands."""
        return self.mapper.objects()
