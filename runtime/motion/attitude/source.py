"""A source of the camera's tilt in each step."""

from collections.abc import Callable, Sequence

from edgemap.geometry.arrays import Array
from edgemap.geometry.camera.attitude import Attitude, TrackedRotation
from edgemap.geometry.camera.mount import Mount
from edgemap.geometry.camera.mount_tilt import MountTiltRule
from edgemap.geometry.se2 import SE2
from edgemap.runtime.frames.faults import Fault
from edgemap.runtime.frames.frame import Frame

Moved = tuple[SE2, Array]  # motion of the base over the step before, the gyro left out, and covariance (3, 3)
NODDING_RAD = MountTiltRule().nod / 2.0  # of a robot on wheels that brakes and rolls over hard floors


class AttitudeSource:
    """Attitudes that depend on the stamp alone: recorded ones, or the mount's in every frame. `EstimatedAttitude`
    measures them; any source is fed every frame in order, and depends on frames, their stamps and IMU samples only.

    faults: those that began in the last `predict`.
    """

    faults: Sequence[Fault] = ()

    def __init__(self, at: Callable[[float], Attitude]) -> None:
        """at: the attitude at a stamp."""
        self._at, self._attitude = at, at(0.0)

    @classmethod
    def of_mount(cls, mount: Mount) -> "AttitudeSource":
        """The mount's angles, with the covariance of a robot that nods."""
        return AttitudeSource(lambda _: Attitude.of_mount(mount, NODDING_RAD))

    def predict(self, frame: Frame, moved: Moved | None = None) -> Attitude:  # noqa: ARG002
        """The camera's attitude at this frame. moved: of the last step; None where it was not measured."""
        self._attitude = self._at(frame.stamp_s)
        return self._attitude

    def update(self, rotation: TrackedRotation | None) -> Attitude:  # noqa: ARG002
        """The last frame's attitude, updated with its rotation by the odometry; None where it measured none."""
        return self._attitude
