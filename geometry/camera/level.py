"""Converts between pitch and roll and the up direction in the optical frame."""

import math

import numpy as np

from edgemap.geometry.arrays import Array
from edgemap.geometry.camera.attitude import MountEstimate
from edgemap.geometry.camera.mount import HeightEstimate, Mount


def up_optical(pitch_rad: float, roll_rad: float) -> Array:
    """Up direction, unit vector (3,), in the optical frame of a camera with this pitch (positive down) and roll."""
    cp = math.cos(pitch_rad)
    return np.array([-cp * math.sin(roll_rad), -cp * math.cos(roll_rad), -math.sin(pitch_rad)])


def angles_text(pitch_deg: float, roll_deg: float) -> str:
    """Both angles of a mount in degrees, for messages."""
    return f"pitch {pitch_deg:.1f} and roll {roll_deg:.1f} deg"


def mount_text(
    configured: Mount,
    estimate: MountEstimate | None,
    height: HeightEstimate | None = None,
    sources: tuple[str, str] = ("given", "given"),
) -> str:
    """One line with the configured and the estimated angles and height of a mount. sources: of the configured angles,
    and of the height."""
    parts = []
    if estimate is not None:
        angles = np.degrees([[mount.pitch_rad, mount.roll_rad] for mount in (configured, estimate.mount)])
        for name, before, after, sigma in zip(
            ("pitch", "roll"), *angles, np.degrees(estimate.sigma_rad[::-1]), strict=True
        ):
            parts.append(f"{name} {before:.1f} deg {sources[0]}, {after:.1f} +- {sigma:.1f} deg estimated")
    if height is not None:
        estimated = f"{height.height_m:.2f} +- {height.sigma_m:.2f} m estimated"
        parts.append(f"height {configured.height_m:.2f} m {sources[1]}, {estimated}")
    return f"mount: {'; '.join(parts)}"


def pitch_roll(up: Array) -> tuple[float, float]:
    """Pitch (positive down) and roll, rad, of a camera, from the up direction (3,) in its optical frame."""
    x, y, z = up / np.linalg.norm(up)
    return math.asin(-z), math.atan2(-x, -y)
