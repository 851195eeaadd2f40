"""The camera's attitude against gravity in one frame, and its rotation since the previous one."""

import math
from dataclasses import dataclass, replace

import numpy as np

from edgemap.geometry.arrays import Array
from edgemap.geometry.camera.carried import Carried
from edgemap.geometry.camera.mount import Mount, pitch_roll


@dataclass(frozen=True, slots=True, eq=False)
class GyroRotation:
    """The camera's rotation from the previous frame to this one, by a gyro whose bias is taken out.

    rotation: (3, 3), takes directions of this frame's optical axes into the previous frame's. yaw_rad: of it as the
    change of the optical axis's heading, counter-clockwise. sigma_rad: standard deviation of yaw_rad. proved: whether
    an odometry has confirmed its sign and scale; also true for a swinging camera, whose rotation only a gyro measures
    well, where gravity turns by its rates. displaced: as of `InertialFilter.displaced`, by the accelerometer; None
    where it integrated nothing.
    """

    rotation: Array
    yaw_rad: float
    sigma_rad: float
    proved: bool = True
    displaced: tuple[Array, Array] | None = None


@dataclass(frozen=True, slots=True, eq=False)
class TrackedRotation:
    """The camera's rotation from the previous frame to this one, as tracked corners show it.

    rotation: (3, 3), takes directions of this frame's optical axes into the previous frame's. carried: the estimate of
    whether the camera is carried, None for a camera at rest. up (3,): direction of up in this frame's optical axes,
    where the odometry estimates it, and up_rad: its standard deviation.
    """

    rotation: Array
    carried: Carried | None = None
    up: Array | None = None
    up_rad: float = math.inf


@dataclass(frozen=True, slots=True, eq=False)
class MountEstimate:
    """A mount's angles as estimated from pictures and accelerometer. sigma_rad: standard deviations of roll and pitch,
    (2,). used: the mount that attitudes refer to: the configured one, with angles corrected where they proved wrong.
    given: the mount as configured.
    """

    mount: Mount
    sigma_rad: Array
    used: Mount
    given: Mount


@dataclass(frozen=True, slots=True, eq=False)
class RoomAxes:
    """Axes of the room in one frame, from its edges. level_rad: from the optical axis's heading to a level direction of
    the room, counter-clockwise, modulo a right angle; None where too few level edges show it. sigma_rad: its standard
    deviation. up: (3,), unit vector of the optical frame. stamp_s: of the frame, where it is known."""

    level_rad: float | None
    sigma_rad: float
    up: Array
    stamp_s: float = math.nan


def rotation_angle(rotation: Array) -> float:
    """Angle of a rotation (3, 3), rad, 0 to pi."""
    return math.acos(min(max((float(np.trace(rotation)) - 1.0) / 2.0, -1.0), 1.0))


@dataclass(frozen=True, slots=True, eq=False)
class Attitude:
    """The camera against gravity in one frame, in the angles of `Mount`: pitch_rad positive looking down, roll_rad
    positive leaning right.

    covariance_rad2: (2, 2) in (roll, pitch), of this frame; what all frames of a drive share is `FloorNoise`'s.
    height_m: the lens above the floor in this frame, None for the mount's. rotation: None without a gyro.
    source: name of the sensor or method, for display. predicted: whether it was computed before the odometry measured
    this frame's rotation. carried: whether the tilt measured from a room's edges scatters more than that of a mounted
    camera. room: its axes in the previous frame, where the edges of that one have just been evaluated. force_rad: roll
    and pitch (2,) by the accelerometer alone. mount: estimate of the mount's angles so far, None where there is none
    yet.
    """

    roll_rad: float
    pitch_rad: float
    covariance_rad2: Array
    height_m: float | None = None
    rotation: GyroRotation | None = None
    source: str = "mount"
    predicted: bool = False
    carried: bool = False
    room: RoomAxes | None = None
    force_rad: Array | None = None
    mount: MountEstimate | None = None

    @classmethod
    def of_mount(cls, mount: Mount, sigma_rad: float = 0.0) -> "Attitude":
        """The mount's angles, each with this standard deviation."""
        return cls(mount.roll_rad, mount.pitch_rad, np.eye(2) * sigma_rad**2)

    @classmethod
    def of_up(cls, up_optical: Array, covariance_rad2: Array, source: str) -> "Attitude":
        """From a vector that points up, (3,) in the optical frame, of any length."""
        pitch_rad, roll_rad = pitch_roll(up_optical)
        return cls(roll_rad, pitch_rad, covariance_rad2, source=source)

    def held_to(self, measured: "Attitude") -> "Attitude":
        """This attitude with roll, pitch, their covariance and the height as measured by another source."""
        return replace(
            self, roll_rad=measured.roll_rad, pitch_rad=measured.pitch_rad, covariance_rad2=measured.covariance_rad2,
            height_m=measured.height_m, source=measured.source, predicted=False,
        )  # fmt: skip
