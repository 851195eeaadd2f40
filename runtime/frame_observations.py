"""What the front end makes of one frame: all that the back end ever sees of it."""

from dataclasses import dataclass, field

from edgemap.geometry.camera.attitude import MountSeen
from edgemap.geometry.camera.floor import FloorCamera
from edgemap.geometry.observations.detections import Detections
from edgemap.geometry.observations.sighting import Sighting
from edgemap.runtime.health import PictureHealth
from edgemap.runtime.odometry.protocol import Motion


@dataclass(frozen=True, slots=True, eq=False)
class FrameObservations:
    """Boxes, objects on the floor and the robot's own motion of one frame, without its picture.

    motion: of the base since the frame before. stages_ms: time of each stage so far, in order. health: of the picture;
    a blind one gives observations only where it is stale and the robot at rest. camera: with the attitude of this
    frame, None for the level robot's. searched: whether objects were detected in it, so that what is missing is gone.
    at_rest: the robot stands still and nothing changed, so the boxes are those of the last picture that was searched.
    mount_fault: one line where sizes or forces show that the mount is wrong, once.
    """

    index: int
    stamp_s: float
    detections: Detections
    sightings: list[Sighting]
    motion: Motion
    stages_ms: dict[str, float] = field(default_factory=dict)
    health: PictureHealth = field(default_factory=PictureHealth)
    camera: FloorCamera | None = None
    searched: bool = True
    at_rest: bool = False
    mount_fault: str = ""

    @property
    def faults(self) -> tuple[str, ...]:
        """What is wrong with the picture, the mount or the motion, where it is news."""
        return tuple(
            dict.fromkeys(filter(None, (self.health.fault, self._attitude_fault, self.mount_fault, self.motion.fault)))
        )

    @property
    def _attitude_fault(self) -> str:
        attitude = self.camera and self.camera.attitude
        return attitude.fault if attitude else ""

    @property
    def attitude_source(self) -> str:
        """Where roll and pitch come from."""
        attitude = self.camera and self.camera.attitude
        return attitude.source if attitude else "mount"

    @property
    def mount_seen(self) -> MountSeen | None:
        """What the drive has shown of the mount so far."""
        attitude = self.camera and self.camera.attitude
        return attitude.mount if attitude else None
