"""Light during a drive, with switched lamps and clouds, and automatic exposure: the gain follows the light with a lag.

The light is that of the air around the robot, baked with the home, so the exposure of a picture needs no other picture,
and pictures can be rendered in any order."""

import math
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import map_coordinates

from edgemap.simulation.render.mesh import Array
from edgemap.simulation.render.scene import Probes
from edgemap.simulation.robot.motion import SampledDrive

# A lamp's filament and a person's hand on the switch.
_SWITCH_S = 0.15


@dataclass(frozen=True, slots=True)
class LightScript:
    """Shares of daylight and lamplight over time; 1 is bright noon and all lamps on.

    switches_s: times at which the lamps change between `lamp`, which holds at first, and `switched`. clouds: stops
    (halvings) of light that the thickest cloud takes. cloud_s: period of the clouds; phase_rad: its phase at the
    start of the drive.
    """

    day: float = 1.0
    lamp: float = 0.0
    switches_s: tuple[float, ...] = ()
    switched: float = 0.0
    clouds: float = 0.0
    cloud_s: float = 20.0
    phase_rad: float = 0.0

    def at(self, time_s: Array | float) -> tuple[Array, Array]:
        """Day and lamp shares at times (N,) in seconds."""
        time = np.asarray(time_s, dtype=np.float64)
        turn = 2.0 * math.pi * time / self.cloud_s + self.phase_rad
        # Two waves that never meet again in the same way.
        cover = 0.5 + 0.3 * np.sin(turn) + 0.2 * np.sin(2.39 * turn + 1.0)
        day = self.day * 0.5 ** (self.clouds * cover)
        lamp = np.full(time.shape, self.lamp)
        for number, switch_s in enumerate(self.switches_s):
            step = (self.switched - self.lamp) * (1.0 if number % 2 == 0 else -1.0)
            lamp = lamp + step / (1.0 + np.exp(-np.clip((time - switch_s) / (_SWITCH_S / 4.0), -50.0, 50.0)))
        return day, lamp


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
