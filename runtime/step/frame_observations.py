"""The front end's result of one frame: the only input of the back end."""

from dataclasses import dataclass, field

from edgemap.geometry.camera.attitude import MountEstimate
from edgemap.geometry.camera.depth_points import SparseDepth
from edgemap.geometry.camera.floor import FloorCamera
from edgemap.geometry.camera.mount import HeightEstimate, Mount
from edgemap.geometry.observations.detections import Detections
from edgemap.geometry.observations.floor_mask import FloorMask
from edgemap.geometry.observations.sighting import Sighting
from edgemap.runtime.frames.faults import Fault
from edgemap.runtime.motion.health import PictureHealth
from edgemap.runtime.motion.odometry.protocol import Motion


@dataclass(frozen=True, slots=True, eq=False)
class FrameObservations:
    """Boxes, objects on the floor and the robot's motion of one frame, without its picture.

    motion: of the base since the frame before. stages_ms: time of each stage so far, in order. health: of the picture;
    a blind one gives observations only where it is stale and the robot at rest. camera: with the attitude of this
    frame, None for the level robot's. searched: whether it brings a detector's boxes, so that a missing detection is
    evidence of absence. before: observations of the earlier picture that detections and sightings are of, where the
    detector is asynchronous. at_rest: the robot stands and nothing changed, so the boxes are those of the last searched
    picture. faults: of picture, mount and motion, each where it begins. height_estimate: estimate of the lens's height
    so far; None without one. floor: the floor mask of this picture; None where it was not searched or the bundle has no
    floor head. depth: every few pixels of the depth picture, where there is one and it was searched. scale: estimated
    over guessed height of the lens, by which all lengths are too short; 1 where the height was stated, or wheels or
    depth measure lengths. worktop: something that people put on furniture stands on what the mask takes for floor.
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
    faults: tuple[Fault, ...] = ()
    height_estimate: HeightEstimate | None = None
    floor: FloorMask | None = None
    depth: SparseDepth | None = None
    scale: float = 1.0
    worktop: bool = False
    before: "FrameObservations | None" = None

    @property
    def pictured(self) -> "FrameObservations":
        """Observations of the picture that detections and sightings are of."""
        return self.before or self

    @property
    def attitude_source(self) -> str:
        """Source of roll and pitch."""
        attitude = self.camera and self.camera.attitude
        return attitude.source if attitude else "mount"

    @property
    def placed_by(self) -> Mount | None:
        """The mount by whose angles this frame's objects were placed; None where each frame has its own."""
        measured = self.camera is None or self.attitude_source in ("depth", "truth", "poses")
        return None if measured or self.camera is None else self.camera.mount

    @property
    def mount_estimate(self) -> MountEstimate | None:
        """Estimate of the mount so far."""
        attitude = self.camera and self.camera.attitude
        return attitude.mount if attitude else None
