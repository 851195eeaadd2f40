"""How the camera is tilted against gravity in one frame, and how it rotated since the one before."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from edgemap.geometry.camera.carried import Carried
from edgemap.geometry.camera.mount import Mount

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class GyroRotation:
    """The camera's rotation from the previous frame to this one, by a gyro whose bias is taken out.

    rotation: (3, 3), takes directions of this frame's optical axes into the previous frame's. yaw_rad: of it as the
    change of the optical axis's heading, counter-clockwise. sigma_rad: standard deviation of yaw_rad. proved: whether
    an odometry has confirmed its sign and scale, or the camera swings, which none measures as well.
    """

    rotation: Array
    yaw_rad: float
    sigma_rad: float
    proved: bool = True

    @property
    def angle_rad(self) -> float:
        """Of the whole rotation, 0 to pi."""
        return rotation_angle(self.rotation)


@dataclass(frozen=True, slots=True, eq=False)
class SeenDirection:
    """direction: (3,), unit, in which the lens moved since an earlier frame, that frame's optical axes. covariance:
    (3, 3) of it, rad^2, rank 2."""

    direction: Array
    covariance: Array


@dataclass(frozen=True, slots=True, eq=False)
class SeenRotation:
    """The camera's rotation from the previous frame to this one, as tracked corners show it.

    rotation: (3, 3), takes directions of this frame's optical axes into the previous frame's. sigma_rad: standard
    deviation about each level axis. carried: what the drive has shown of that so far, None of a camera at rest.
    travelled: the direction in which the lens moved over the last few frames, where it has just been measured.
    """

    rotation: Array
    sigma_rad: float
    carried: Carried | None = None
    travelled: SeenDirection | None = None


@dataclass(frozen=True, slots=True, eq=False)
class MountSeen:
    """A mount's angles as pictures and forces show them. sigma_rad: standard deviations of roll and pitch, (2,). used:
    the mount that attitudes are about, as given but for angles that are wrong. given: as it was given."""

    mount: Mount
    sigma_rad: Array
    used: Mount
    given: Mount


@dataclass(frozen=True, slots=True)
class RoomHeading:
    """How the room lies in the frame of a stamp, by its edges. level_rad, sigma_rad: as of `RoomAxes`."""

    stamp_s: float
    level_rad: float
    sigma_rad: float


def rotation_angle(rotation: Array) -> float:
    """Angle of a rotation (3, 3), rad, 0 to pi."""
    return math.acos(min(max((float(np.trace(rotation)) - 1.0) / 2.0, -1.0), 1.0))


@dataclass(frozen=True, slots=True, eq=False)
class Attitude:
    """The camera against gravity in one frame, in the angles of `Mount`: pitch_rad positive looking down, roll_rad
    positive leaning right.

    covariance_rad2: (2, 2) in (roll, pitch), of this frame; what all frames of a drive share is `FloorNoise`'s.
    height_m: the lens above the floor in this frame, None for the mount's. rotation: None without a gyro.
    source: what it comes from, for people. predicted: by what is known before this frame's rotation; the odometry shows
    that. fault: one line where it shows that the mount is wrong, once.
    carried: whether the tilt by a room's edges scatters as that of a mounted camera does not. room: where
    the edges of an earlier frame have just told it. force_rad: roll and pitch (2,) by the accelerometer alone. mount:
    what the drive has shown of it so far, None for nothing.
    """

    roll_rad: float
    pitch_rad: float
    covariance_rad2: Array
    height_m: float | None = None
    rotation: GyroRotation | None = None
    source: str = "mount"
    predicted: bool = False
    fault: str = ""
    carried: bool = False
    room: RoomHeading | None = None
    force_rad: Array | None = None
    mount: MountSeen | None = None

    @classmethod
    def of_mount(cls, mount: Mount, sigma_rad: float = 0.0) -> Attitude:
        """The mount's own angles, each with this standard deviation."""
        return cls(mount.roll_rad, mount.pitch_rad, np.eye(2) * sigma_rad**2)

    @classmethod
    def of_up(cls, up_optical: Array, covariance_rad2: Array, source: str) -> Attitude:
        """From the direction that points up, (3,) in the optical frame, any length."""
        right, down, forward = (float(value) for value in up_optical)
        roll_rad = math.atan2(-right, -down)
        pitch_rad = math.atan2(-forward, math.hypot(right, down))
        return cls(roll_rad, pitch_rad, covariance_rad2, source=source)
