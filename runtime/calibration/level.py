"""Pitch and roll from where up is in the picture, and back."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from edgemap.geometry.camera.attitude import MountSeen
from edgemap.geometry.camera.mount import Mount

Array = NDArray[np.float64]


def up_optical(pitch_rad: float, roll_rad: float) -> Array:
    """The direction up, (3,), in the optical frame of a camera mounted so: last row of `rotation_base_optical`."""
    cp = math.cos(pitch_rad)
    return np.array([-cp * math.sin(roll_rad), -cp * math.cos(roll_rad), -math.sin(pitch_rad)])


def angles_text(pitch_deg: float, roll_deg: float) -> str:
    """Both angles of a mount, in degrees, as messages name them."""
    return f"pitch {pitch_deg:.1f} and roll {roll_deg:.1f} deg"


def seen_text(given: Mount, seen: MountSeen) -> str:
    """A mount's angles as given and as a drive has shown them, one line."""
    pitch = given.pitch_rad, seen.mount.pitch_rad, seen.sigma_rad[1]
    roll = given.roll_rad, seen.mount.roll_rad, seen.sigma_rad[0]
    told = ("{:.1f} deg given, {:.1f} +- {:.1f} deg seen".format(*np.degrees(angle)) for angle in (pitch, roll))
    return "mount: pitch {}; roll {}".format(*told)


def pitch_roll(up: Array) -> tuple[float, float]:
    """Pitch (positive down) and roll, rad, of the camera that sees up in this direction of its optical frame."""
    x, y, z = up / np.linalg.norm(up)
    return math.asin(-z), math.atan2(-x, -y)
