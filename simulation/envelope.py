"""The training envelope of simulated drives, with units, and random draws from it."""

import math
from dataclasses import dataclass

import numpy as np

from edgemap.geometry.camera.intrinsics import Distortion, Intrinsics
from edgemap.geometry.camera.mount import Mount
from edgemap.simulation.camera.exposure import LightScript
from edgemap.simulation.camera.film import CameraSetup, Effects
from edgemap.simulation.robot.motion import Limits

Range = tuple[float, float]


@dataclass(frozen=True, slots=True)
class Envelope:
    """Ranges are (least, most), drawn evenly; shares are probabilities."""

    width_px: int = 640
    height_px: int = 480
    rate_hz: float = 10.0
    # The camera on the robot. It looks at a point of this height, this far away, give or take some degrees.
    height_m: Range = (0.15, 1.3)
    aim_height_m: float = 0.35
    aim_distance_m: Range = (1.8, 5.0)
    aim_error_deg: Range = (-3.0, 7.0)
    pitch_deg: Range = (-5.0, 30.0)
    roll_deg: Range = (-1.0, 1.0)
    forward_m: Range = (-0.10, 0.30)
    left_m: Range = (-0.08, 0.08)
    # The lens.
    horizontal_view_deg: Range = (55.0, 90.0)
    aspect_error: Range = (-0.005, 0.005)
    centre_error_px: Range = (-10.0, 10.0)
    distorted: float = 0.5
    k1: Range = (-0.20, 0.06)
    k2_per_k1: Range = (-0.5, 0.0)
    tangential: Range = (-0.001, 0.001)
    # The sensor.
    exposure_s: Range = (0.004, 0.020)
    readout_s: Range = (0.0, 0.020)
    shake_deg: Range = (0.0, 0.3)
    shot: Range = (0.005, 0.03)
    read: Range = (0.0005, 0.003)
    lag_s: Range = (0.2, 1.0)
    jpeg_quality: tuple[int, int] = (80, 97)
    # Light: by day, by lamplight, both, or little of either; and how often it changes during a drive.
    day: float = 0.4
    lamp: float = 0.25
    mixed: float = 0.2
    changes: float = 0.35
    # People walking about: shares of 0, 1 and 2.
    people: tuple[float, float, float] = (0.55, 0.3, 0.15)
    # The robot.
    speed_m_s: Range = (0.50, 0.70)
    acceleration_m_s2: Range = (0.45, 0.8)
    yaw_rate_rad_s: Range = (0.8, 1.3)

    def draw_camera(self, rng: np.random.Generator) -> CameraSetup:
        """A random camera on a plausible mount: low cameras have less pitch."""
        height = rng.uniform(*self.height_m)
        aimed = math.degrees(math.atan((height - self.aim_height_m) / rng.uniform(*self.aim_distance_m)))
        pitch = float(np.clip(aimed + rng.uniform(*self.aim_error_deg), *self.pitch_deg))
        mount = Mount.from_degrees(
            round(height, 4),
            round(pitch, 3),
            round(rng.uniform(*self.roll_deg), 3),
            round(rng.uniform(*self.forward_m), 4),
            round(rng.uniform(*self.left_m), 4),
        )
        focal = self.width_px / 2.0 / math.tan(math.radians(rng.uniform(*self.horizontal_view_deg)) / 2.0)
        lens = Intrinsics(
            self.width_px,
            self.height_px,
            round(focal, 3),
            round(focal * (1.0 + rng.uniform(*self.aspect_error)), 3),
            round((self.width_px - 1) / 2.0 + rng.uniform(*self.centre_error_px), 3),
            round((self.height_px - 1) / 2.0 + rng.uniform(*self.centre_error_px), 3),
            self._draw_distortion(rng, focal),
        )
        return CameraSetup(lens, mount, self.rate_hz)

    def draw_effects(self, rng: np.random.Generator, light: LightScript) -> Effects:
        """A sensor; in little light it exposes for longer."""
        brightness = max(0.1, light.day + 0.6 * light.lamp)
        return Effects(
            exposure_s=min(0.033, rng.uniform(*self.exposure_s) * brightness**-0.4),
            readout_s=rng.uniform(*self.readout_s),
            shake_rad=math.radians(rng.uniform(*self.shake_deg)),
            shot=rng.uniform(*self.shot),
            read=rng.uniform(*self.read),
            lag_s=rng.uniform(*self.lag_s),
            jpeg_quality=int(rng.integers(self.jpeg_quality[0], self.jpeg_quality[1] + 1)),
        )

    def draw_light(self, rng: np.random.Generator) -> LightScript:
        """Light and, now and then, a change of it: a lamp switched every ten seconds or so, or clouds."""
        kind = rng.choice(4, p=[self.day, self.lamp, self.mixed, 1.0 - self.day - self.lamp - self.mixed])
        return light_of(list(_LIGHTS)[int(kind)], rng, changes=bool(rng.random() < self.changes))

    def draw_limits(self, rng: np.random.Generator) -> Limits:
        """Random speed and acceleration limits of the robot."""
        names = ("speed_m_s", "acceleration_m_s2", "yaw_rate_rad_s")
        return Limits(**{name: rng.uniform(*getattr(self, name)) for name in names})

    def _draw_distortion(self, rng: np.random.Generator, focal_px: float) -> Distortion:
        if rng.random() >= self.distorted:
            return Distortion()
        k1, share = rng.uniform(*self.k1), rng.uniform(*self.k2_per_k1)
        tangential = rng.uniform(*self.tangential, 2)
        corner = math.hypot(self.width_px, self.height_px) / 2.0 / focal_px
        while not _reaches(1.05 * corner, k1, share * k1):
            k1 *= 0.8
        numbers = (k1, share * k1, *tangential)
        return Distortion("brown_conrady", tuple(round(float(number), 6) for number in numbers))


def _reaches(radius: float, k1: float, k2: float) -> bool:
    """Whether a lens still bends outwards, and no more than three times too little, where the picture ends."""
    ideal = np.linspace(0.0, 2.0 * radius, 400)
    distorted = ideal * (1.0 + k1 * ideal**2 + k2 * ideal**4)
    slope = 1.0 + 3.0 * k1 * ideal**2 + 5.0 * k2 * ideal**4
    first = int(np.argmax(distorted >= radius))
    return bool(distorted[first] >= radius and slope[: first + 1].min() > 0.35)


# Shares of daylight and of lamplight, by kind of light.
_LIGHTS: dict[str, tuple[Range, Range]] = {
    "day": ((0.6, 1.0), (0.0, 0.0)),
    "lamp": ((0.0, 0.0), (0.6, 1.0)),
    "mixed": ((0.2, 0.7), (0.4, 0.9)),
    "dim": ((0.06, 0.2), (0.0, 0.12)),
}


def light_of(name: str, rng: np.random.Generator, changes: bool = False) -> LightScript:
    """A light of a kind: day, lamp (after dark), mixed, dim, or changing (lamps switched by day)."""
    if name == "changing":
        name, changes = "mixed", True
    day, lamp = _LIGHTS[name]
    script = LightScript(day=rng.uniform(*day), lamp=rng.uniform(*lamp))
    first_s, every_s = rng.uniform(8.0, 22.0), rng.uniform(9.0, 25.0)
    clouds, cloud_s, phase = rng.uniform(1.0, 2.2), rng.uniform(15.0, 40.0), rng.uniform(0.0, 2.0 * math.pi)
    if not changes:
        return script
    if name == "day" and rng.random() < 0.5:
        return LightScript(script.day, script.lamp, clouds=clouds, cloud_s=cloud_s, phase_rad=phase)
    # Two hours of switching: longer than anybody records.
    times = tuple(round(float(first_s + every_s * number), 3) for number in range(int(7200.0 / every_s)))
    other = rng.uniform(0.5, 0.9) if script.lamp < 0.3 else rng.uniform(0.02, 0.15)
    return LightScript(script.day, script.lamp, times, float(other))


CARRIED = Envelope(height_m=(1.2, 1.75), aim_distance_m=(1.2, 4.0), pitch_deg=(5.0, 45.0))  # by a person who walks
