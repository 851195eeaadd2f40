"""Sources of the camera's tilt in each step."""

from collections.abc import Sequence
from typing import Protocol

from edgemap.geometry.arrays import Array
from edgemap.geometry.camera.attitude import Attitude, TrackedRotation
from edgemap.geometry.camera.mount import Mount
from edgemap.geometry.camera.mount_tilt import MountTiltRule
from edgemap.geometry.se2 import SE2
from edgemap.runtime.frames.faults import Fault
from edgemap.runtime.frames.frame import Frame
from edgemap.runtime.frames.trajectory import AttitudeTrack

Moved = tuple[SE2, Array]  # motion of the base over the step before, the gyro left out, and covariance (3, 3)
NODDING_RAD = MountTiltRule().nod / 2.0  # of a robot on wheels that brakes and rolls over hard floors


class AttitudeSource(Protocol):
    """Fed every frame in order; depends on frames, their stamps and their IMU samples only."""

    @property
    def faults(self) -> Sequence[Fault]:
        """Those that began in the last `predict`."""
        ...

    def predict(self, frame: Frame, moved: Moved | None = None) -> Attitude:
        """The camera's attitude at this frame. moved: of the last step; None where it was not measured."""
        ...

    def update(self, rotation: TrackedRotation | None) -> Attitude:
        """The last frame's attitude, updated with its rotation by the odometry; None where it measured none."""
        ...


class MountAttitude:
    """The mount's angles in every frame, with the covariance of a robot that nods."""

    faults = ()

    def __init__(self, mount: Mount, sigma_rad: float = NODDING_RAD) -> None:
        self._attitude = Attitude.of_mount(mount, sigma_rad)

    def predict(self, frame: Frame, moved: Moved | None = None) -> Attitude:  # noqa: ARG002
        """The mount's attitude, the same in every frame."""
        return self._attitude

    def update(self, rotation: TrackedRotation | None) -> Attitude:  # noqa: ARG002
        """The mount's attitude, whatever was tracked."""
        return self._attitude


class RecordedAttitude:
    """The attitude of recorded 6-DoF poses."""

    faults = ()

    def __init__(self, track: AttitudeTrack, mount: Mount) -> None:
        self._track, self._height_m, self._seen_s = track, mount.height_m, 0.0

    def predict(self, frame: Frame, moved: Moved | None = None) -> Attitude:  # noqa: ARG002
        """Read off the track at the frame's stamp."""
        self._seen_s = frame.stamp_s
        return self._track.at(frame.stamp_s, self._height_m)

    def update(self, rotation: TrackedRotation | None) -> Attitude:  # noqa: ARG002
        """Returns the same attitude: there is no prediction to correct."""
        return self._track.at(self._seen_s, self._height_m)
