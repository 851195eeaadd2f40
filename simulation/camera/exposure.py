"""Automatic exposure: how much the camera brightens the picture, following the light with a lag."""

from __future__ import annotations

import numpy as np

from edgemap.simulation.light_script import LightScript
from edgemap.simulation.render.mesh import Array

# How bright a room is under all of its lamps, against full daylight.
LAMP_LEVEL = 0.8
# A camera makes up for most of a change of light, not for all of it, and only so far.
_SHARE, _LEAST, _MOST = 0.85, 0.5, 8.0
_STEP_S = 0.02


def gains(script: LightScript, stamps_s: Array, lag_s: float) -> Array:
    """Brightening (N,) at increasing stamps, 1 in full daylight.

    It follows from the light alone, never from pictures taken before: every picture can be made by itself.
    """
    settled_s = 8.0 * lag_s + 1.0
    time = np.arange(-settled_s, float(np.max(stamps_s, initial=0.0)) + _STEP_S, _STEP_S)
    day, lamp = script.at(time)
    wanted = np.log(np.clip((day + LAMP_LEVEL * lamp + 1e-3) ** -_SHARE, _LEAST, _MOST))
    keep = float(np.exp(-_STEP_S / lag_s)) if lag_s > 0.0 else 0.0
    reached = np.empty_like(wanted)
    level = wanted[0]
    for index, goal in enumerate(wanted):
        level = keep * level + (1.0 - keep) * goal
        reached[index] = level
    return np.exp(np.interp(stamps_s, time, reached))
