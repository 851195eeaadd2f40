"""What the front end makes of one frame: all that the back end ever sees of it."""

from __future__ import annotations

from dataclasses import dataclass, field

from edgemap.geometry.observations.detections import Detections
from edgemap.geometry.observations.sighting import Sighting
from edgemap.runtime.odometry.protocol import Motion


@dataclass(frozen=True, slots=True, eq=False)
class FrameObservations:
    """Boxes, objects on the floor and the robot's own motion of one frame, without its picture.

    motion: of the base since the frame before. stages_ms: time of each stage so far, in order.
    """

    index: int
    stamp_s: float
    detections: Detections
    sightings: list[Sighting]
    motion: Motion
    stages_ms: dict[str, float] = field(default_factory=dict)
