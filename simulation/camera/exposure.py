"""Light during a drive, with switched lamps and clouds, and automatic exposure whose gain follows the light with a lag.

The light level is that of the air around the robot and is baked with the home. The exposure of a picture therefore
needs no other picture, and pictures can be rendered in any order."""

import math
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import map_coordinates
from scipy.signal import lfilter

from edgemap.simulation.render.mesh import Array
from edgemap.simulation.render.scene import Probes
from edgemap.simulation.robot.motion import Sampled

# Time that a lamp takes to switch.
_SWITCH_S = 0.15


@dataclass(frozen=True, slots=True)
class LightScript:
    """Shares of daylight and lamplight over time; 1 is bright noon and all lamps on.

    switches_s: times at which the lamps change between `lamp`, the initial share, and `switched`. clouds: stops
    (halvings) by which the thickest cloud reduces daylight. cloud_s: period of the clouds; phase_rad: its phase at the
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
        # The sum of these two sine waves does not repeat during a drive.
        cover = 0.5 + 0.3 * np.sin(turn) + 0.2 * np.sin(2.39 * turn + 1.0)
        day = self.day * 0.5 ** (self.clouds * cover)
        lamp = np.full(time.shape, self.lamp)
        for number, switch_s in enumerate(self.switches_s):
            step = (self.switched - self.lamp) * (1.0 if number % 2 == 0 else -1.0)
            lamp = lamp + step / (1.0 + np.exp(-np.clip((time - switch_s) / (_SWITCH_S / 4.0), -50.0, 50.0)))
        return day, lamp


# Light (irradiance / pi) at which a picture is well exposed with a gain of 1.
_GOOD_LEVEL = 0.25
# A camera compensates for most of a lack of light, but not for all of it, and only within these limits of the gain.
_SHARE, _LEAST, _MOST = 0.85, 0.4, 12.0
_STEP_S = 0.02
# Exposure is measured at this distance ahead of the robot.
_AHEAD_M = 1.2


def light_levels(probes: Probes, poses: Array) -> tuple[Array, Array]:
    """Mean light in full daylight and with all lamps on, ahead of base poses (N, 3): irradiance / pi, (N,) each."""
    ahead = poses[:, :2] + _AHEAD_M * np.stack([np.cos(poses[:, 2]), np.sin(poses[:, 2])], axis=1)
    at = ((ahead - probes.corner_m[:2]) / probes.step_m[:2]).T
    lamp, day = (
        map_coordinates(np.ascontiguousarray(light).mean(axis=(2, 3, 4)), at, order=1, mode="nearest")
        for light in np.split(probes.light, 2, axis=-1)
    )
    return day, lamp


def settled_gain(level: Array) -> Array:
    """Gain (N,) after the exposure has settled; 1 in good light. level: irradiance / pi, (N,)."""
    return np.clip((np.asarray(level) / _GOOD_LEVEL + 1e-4) ** -_SHARE, _LEAST, _MOST)


def gains(probes: Probes, script: LightScript, motion: Sampled, stamps_s: Array, lag_s: float) -> Array:
    """Exposure gains (N,) at increasing stamps of a drive. The gain approaches `settled_gain` exponentially.

    lag_s: time constant of the logarithm of the gain, s.
    """
    time = np.arange(0.0, float(np.max(stamps_s, initial=0.0)) + 2.0 * _STEP_S, _STEP_S)
    day_share, lamp_share = script.at(time)
    day, lamp = light_levels(probes, motion.at(time))
    wanted = np.log(settled_gain(day_share * day + lamp_share * lamp))
    keep = float(np.exp(-_STEP_S / lag_s)) if lag_s > 0.0 else 0.0
    reached, _ = lfilter([1.0 - keep], [1.0, -keep], wanted, zi=[keep * wanted[0]])
    return np.exp(np.interp(stamps_s, time, reached))
