"""Sources of the camera's tilt in each step."""

from collections.abc import Sequence
from typing import Protocol

from edgemap.geometry.arrays import Array
from edgemap.geometry.camera.attitude import Attitude, TrackedRotation
from edgemap.geometry.se2 import SE2
from edgemap.runtime.frames.faults import Fault
from edgemap.runtime.frames.frame import Frame

Moved = tuple[SE2, Array]  # motion of the base over the step before, the gyro left out, and covariance (3, 3)


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
