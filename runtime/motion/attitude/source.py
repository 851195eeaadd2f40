"""A source of the camera's tilt in each step."""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

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

    def update(self, rotation: TrackedRotation | None) -> Attitude:
        """The last frame's attitude after its motion: with the tilt of the odometry where that has the smaller
        covariance; the source keeps its estimate. rotation: by the odometry, None where it measured none."""
        attitude = self._attitude
        limit_rad = math.sqrt(float(np.trace(attitude.covariance_rad2)) / 2.0)
        if rotation is None or rotation.up is None or rotation.up_rad >= limit_rad:
            return attitude
        tracked = Attitude.of_up(rotation.up, np.eye(2) * rotation.up_rad**2, attitude.source)
        return attitude.held_to(replace(tracked, height_m=attitude.height_m))
