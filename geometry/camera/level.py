"""Converts between pitch and roll and the up direction in the optical frame."""

import math

import numpy as np

from edgemap.geometry.arrays import Array


def up_optical(pitch_rad: float, roll_rad: float) -> Array:
    """Up direction, unit vector (3,), in the optical frame of a camera with this pitch (positive down) and roll."""
    cp = math.cos(pitch_rad)
    return np.array([-cp * math.sin(roll_rad), -cp * math.cos(roll_rad), -math.sin(pitch_rad)])


def angles_text(pitch_deg: float, roll_deg: float) -> str:
    """Both angles of a mount in degrees, for messages."""
    return f"pitch {pitch_deg:.1f} and roll {roll_deg:.1f} deg"


def pitch_roll(up: Array) -> tuple[float, float]:
    """Pitch (positive down) and roll, rad, of a camera, from the up direction (3,) in its optical frame."""
    x, y, z = up / np.linalg.norm(up)
    return math.asin(-z), math.atan2(-x, -y)
