"""Vibration: the mount's pitch and roll are a little different in every picture."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from edgemap.geometry.camera.mount import Mount

# Speeds at which a robot shakes as much as `shake_rad` says; standing still it does not.
_SPEED_M_S, _YAW_RATE_RAD_S = 0.4, 0.8


def shaken(mount: Mount, shake_rad: float, velocity: np.ndarray, rng: np.random.Generator) -> Mount:
    """The mount in one picture, with shake. velocity: forward m/s, left m/s, yaw rad/s of the base."""
    strength = min(1.0, abs(velocity[0]) / _SPEED_M_S + abs(velocity[2]) / _YAW_RATE_RAD_S)
    pitch, roll = rng.normal(0.0, 1.0, 2) * shake_rad * strength
    return replace(mount, pitch_rad=mount.pitch_rad + pitch, roll_rad=mount.roll_rad + roll)
