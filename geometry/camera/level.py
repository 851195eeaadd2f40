"""Converts between pitch and roll and the up direction in the optical frame."""

import math

import numpy as np
from numpy.typing import NDArray

from edgemap.geometry.camera.attitude import MountEstimate
from edgemap.geometry.camera.mount import HeightEstimate, Mount

Array = NDArray[np.float64]


def up_optical(pitch_rad: float, roll_rad: float) -> Array:
    """Up direction, unit vector (3,), in the optical frame of a camera with this pitch (positive down) and roll."""
    cp = math.cos(pitch_rad)
    return np.array([-cp * math.sin(roll_rad), -cp * math.cos(roll_rad), -math.sin(pitch_rad)])


def angles_text(pitch_deg: float, roll_deg: float) -> str:
    """Both angles of a mount in degrees, for messages."""
    return f"pitch {pitch_deg:.1f} and roll {roll_deg:.1f} deg"


def seen_text(
    given: Mount,
    seen: MountEstimate | None,
    height: HeightEstimate | None = None,
    sources: tuple[str, str] = ("given", "given"),
) -> str:
    """One line with the configured and the estimated angles and height of a mount. sources: of the configured angles,
    and of the height."""
    parts = []
    if seen is not None:
        pitch = given.pitch_rad, seen.mount.pitch_rad, seen.sigma_rad[1]
        roll = given.roll_rad, seen.mount.roll_rad, seen.sigma_rad[0]
        for name, angle in (("pitch", pitch), ("roll", roll)):
            parts.append(name + f" {{:.1f}} deg {sources[0]}, {{:.1f}} +- {{:.1f}} deg seen".format(*np.degrees(angle)))
    if height is not None:
        parts.append(
            f"height {given.height_m:.2f} m {sources[1]}, {height.height_m:.2f} +- {height.sigma_m:.2f} m seen"
        )
    return f"mount: {'; '.join(parts)}"


def pitch_roll(up: Array) -> tuple[float, float]:
    """Pitch (positive down) and roll, rad, of a camera, from the up direction (3,) in its optical frame."""
    x, y, z = up / np.linalg.norm(up)
    return math.asin(-z), math.atan2(-x, -y)
