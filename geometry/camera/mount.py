"""The camera's mount on the robot: height, pitch, roll and lever arm relative to the base (the turn axis)."""

import math
from dataclasses import dataclass
from enum import StrEnum
from functools import lru_cache

import numpy as np

from edgemap.geometry.arrays import Array
from edgemap.geometry.errors import GeometryError

QUARTER_TURN = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])  # of optical axes, pictures clockwise
# Columns are the optical axes (right, down, forward) in base axes (forward, left, up).
BASE_OPTICAL = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])


class Platform(StrEnum):
    """robot: on wheels or carried, in rooms. car: on a road, as in KITTI."""

    ROBOT = "robot"
    CAR = "car"

    @property
    def unit_m(self) -> float:
        """Unit of length, metres, in which noise and priors of odometries are stated: about the distance to the nearest
        floor in view."""
        return 8.0 if self is Platform.CAR else 1.0

    @property
    def in_room(self) -> bool:
        """Whether straight edges are those of a room, upright or along two directions, a floor head (trained on rooms)
        knows the floor, and corners are refined by detail."""
        return self is Platform.ROBOT


@dataclass(frozen=True, slots=True)
class Mount:
    """Pose of the camera on the robot, constant over a drive.

    height_m: lens above the floor. pitch_rad: positive looking DOWN. roll_rad: positive leaning right
    (the picture's right side sinks). forward_m, left_m: lens ahead of and left of the turn axis. platform: what it
    rides on.
    Frames as in REP-103. Raises GeometryError for values that are not finite, a height that is not
    positive, or an angle of 90 degrees or more.
    """

    height_m: float
    pitch_rad: float = 0.0
    roll_rad: float = 0.0
    forward_m: float = 0.0
    left_m: float = 0.0
    platform: Platform = Platform.ROBOT

    def __post_init__(self) -> None:
        for name in ("height_m", "pitch_rad", "roll_rad", "forward_m", "left_m"):
            if not math.isfinite(getattr(self, name)):
                raise GeometryError(f"mount: {name} is {getattr(self, name)}, must be a finite number")
        if self.height_m <= 0:
            raise GeometryError(f"mount: height is {self.height_m} m, must be above the floor (positive)")
        for name in ("pitch_rad", "roll_rad"):
            if abs(getattr(self, name)) >= math.pi / 2:
                degrees = math.degrees(getattr(self, name))
                raise GeometryError(f"mount: {name[:-4]} is {degrees:.1f} deg, must be between -90 and 90")

    @classmethod
    def from_degrees(
        cls,
        height_m: float,
        pitch_deg: float,
        roll_deg: float = 0.0,
        forward_m: float = 0.0,
        left_m: float = 0.0,
        platform: Platform = Platform.ROBOT,
    ) -> "Mount":
        """A mount with its angles in degrees, as people and camera.yaml write them."""
        return cls(height_m, math.radians(pitch_deg), math.radians(roll_deg), forward_m, left_m, platform)

    def rotation_base_optical(self) -> Array:
        """3x3 rotation that takes directions of the optical frame into the base frame."""
        return rotation_base_optical(self.pitch_rad, self.roll_rad)

    def position_base_m(self) -> Array:
        """Position of the lens in the base frame, (3,) in metres; the base's origin is on the floor."""
        return np.array([self.forward_m, self.left_m, self.height_m])

    def floor_by_tilt(self, point_base_m: Array) -> Array:
        """Derivative (2, 2) by roll and pitch, m per rad, of where a ray meets the floor, (2,), base frame."""
        x, y = (point_base_m - [self.forward_m, self.left_m]).tolist()
        h, c, s = self.height_m, math.cos(self.pitch_rad), math.sin(self.pitch_rad)  # it rolls about the pitched axis
        by_roll = [c * x * y + s * h * y, c * (h * h + y * y) - s * h * x]
        return np.column_stack([by_roll, [-(h * h + x * x), -x * y]]) / h


@dataclass(frozen=True, slots=True)
class HeightEstimate:
    """Estimated height of a lens above the floor and its standard deviation, metres."""

    height_m: float
    sigma_m: float


@lru_cache(maxsize=64)
def rotation_base_optical(pitch_rad: float, roll_rad: float) -> Array:
    """Rotation of a mount with these angles; cached, since a frame needs it some twenty times, and read-only."""
    cp, sp = math.cos(pitch_rad), math.sin(pitch_rad)
    cr, sr = math.cos(roll_rad), math.sin(roll_rad)
    pitch = np.array([[cp, 0.0, sp], [0.0, 1.0, 0.0], [-sp, 0.0, cp]])  # about y (left): x tips down
    roll = np.array([[1.0, 0.0, 0.0], [0.0, cr, -sr], [0.0, sr, cr]])  # about x (forward)
    rotation = pitch @ roll @ BASE_OPTICAL
    rotation.setflags(write=False)
    return rotation


def up_optical(pitch_rad: float, roll_rad: float) -> Array:
    """Up direction, unit vector (3,), in the optical frame of a camera with this pitch (positive down) and roll."""
    return rotation_base_optical(pitch_rad, roll_rad)[2]


def pitch_roll(up: Array) -> tuple[float, float]:
    """Pitch (positive down) and roll, rad, of a camera, from the up direction (3,), of any length, in its optical
    frame."""
    right, down, forward = up.tolist()
    return math.atan2(-forward, math.hypot(right, down)), math.atan2(-right, -down)
