"""Changes of the light during a drive: switched lamps, and clouds."""

import math
from dataclasses import dataclass

import numpy as np

from edgemap.simulation.render.mesh import Array

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
