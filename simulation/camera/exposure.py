"""Automatic exposure: the camera's gain, which follows the light with a lag.

The light is that of the air around the robot, baked with the home. So the exposure of a picture needs no other
picture, and pictures can be rendered in any order.
"""

import numpy as np
from scipy.ndimage import map_coordinates

from edgemap.simulation.light_script import LightScript
from edgemap.simulation.render.mesh import Array
from edgemap.simulation.render.scene import Probes
from edgemap.simulation.robot.motion import SampledDrive

# Light (irradiance / pi) at which a picture comes out right as it is.
_GOOD_LEVEL = 0.25
# A camera makes up for most of a lack of light, not for all of it, and only so far.
_SHARE, _LEAST, _MOST = 0.85, 0.4, 12.0
_STEP_S = 0.02
# It looks at the room before it.
_AHEAD_M = 1.2


def light_levels(probes: Probes | None, poses: Array) -> tuple[Array, Array]:
    """Mean light by full day and by all lamps (irradiance / pi, each (N,)) before poses (N, 3) of the base."""
    if probes is None:
        return np.full(len(poses), _GOOD_LEVEL), np.full(len(poses), _GOOD_LEVEL)
    ahead = poses[:, :2] + _AHEAD_M * np.stack([np.cos(poses[:, 2]), np.sin(poses[:, 2])], axis=1)
    at = ((ahead - probes.corner_m[:2]) / probes.step_m[:2]).T
    day, lamp = (
        map_coordinates(light.mean(axis=(2, 3, 4)), at, order=1, mode="nearest") for light in (probes.day, probes.lamp)
    )
    return day, lamp


def settled_gain(level: Array) -> Array:
    """Brightening once the camera has settled, 1 in good light. level: irradiance / pi, (N,)."""
    return np.clip((np.asarray(level) / _GOOD_LEVEL + 1e-4) ** -_SHARE, _LEAST, _MOST)


def gains(probes: Probes | None, script: LightScript, motion: SampledDrive, stamps_s: Array, lag_s: float) -> Array:
    """Brightening (N,) at increasing stamps along a drive; it follows the settled one exponentially."""
    time = np.arange(0.0, float(np.max(stamps_s, initial=0.0)) + 2.0 * _STEP_S, _STEP_S)
    day_share, lamp_share = script.at(time)
    day, lamp = light_levels(probes, motion.at(time))
    wanted = np.log(settled_gain(day_share * day + lamp_share * lamp))
    keep = float(np.exp(-_STEP_S / lag_s)) if lag_s > 0.0 else 0.0
    reached = np.empty_like(wanted)
    level = wanted[0]
    for index, goal in enumerate(wanted):
        level = keep * level + (1.0 - keep) * goal
        reached[index] = level
    return np.exp(np.interp(stamps_s, time, reached))
