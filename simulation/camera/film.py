"""The simulated camera: lens, mount and effects of its sensor on a rendered picture: vibration, shutter, noise, JPEG.

Shot noise grows with the square root of the light, read noise is constant; both grow with the gain."""

from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from edgemap.geometry.camera.intrinsics import Intrinsics
from edgemap.geometry.camera.mount import Mount
from edgemap.runtime.frames.frame import jpeg, png
from edgemap.simulation.camera.shutter import Twist, exposed
from edgemap.simulation.render.renderer import RenderedFrame

_INTRINSICS = Intrinsics(640, 480, 587.0, 587.0, 319.5, 239.5)
_MOUNT = Mount.from_degrees(0.60, 11.5, forward_m=0.15)


@dataclass(frozen=True, slots=True)
class CameraSetup:
    """Intrinsics and mount; the default is the demo's."""

    intrinsics: Intrinsics = _INTRINSICS
    mount: Mount = _MOUNT
    rate_hz: float = 10.0


@dataclass(frozen=True, slots=True)
class Effects:
    """Effects of a real camera; all zero leaves the rendered picture unchanged.

    exposure_s: shutter time in good light. readout_s: from the first row to the last. shake_rad: standard deviation of
    pitch and roll per picture while driving. shot, read: standard deviations of the noise at gain 1, as a share of full
    scale: at full scale, and in the dark. lag_s: of the automatic exposure. jpeg_quality: 0..100; None for none.
    """

    exposure_s: float = 0.0
    readout_s: float = 0.0
    shake_rad: float = 0.0
    shot: float = 0.0
    read: float = 0.0
    lag_s: float = 0.6
    jpeg_quality: int | None = None


_GAMMA = 2.2
# Speeds from which a robot shakes by `shake_rad`; at rest it does not.
_SPEED_M_S, _YAW_RATE_RAD_S = 0.4, 0.8


def sensed(
    frame: RenderedFrame, lens: Intrinsics, twist: Twist, effects: Effects, gain: float, rng: np.random.Generator
) -> NDArray[np.uint8]:
    """Sensor model: the picture (H, W, 3) of a frame that was rendered for the middle of its exposure.

    twist: of the camera, as `optical_twist` gives it. gain: how much the picture was brightened, 1 in good light.
    """
    picture = frame.picture
    if effects.exposure_s or effects.readout_s:
        picture = exposed(picture, frame.depth_m, lens, twist, effects.exposure_s, effects.readout_s)
    if effects.shot or effects.read:
        picture = noisy(picture, effects.shot, effects.read, gain, rng)
    return picture


def encoded(picture: NDArray[np.uint8], jpeg_quality: int | None) -> tuple[bytes, str]:
    """The encoded picture and the suffix of its file: JPEG, or PNG where jpeg_quality is None."""
    if jpeg_quality is None:
        # OpenCV's default compression: for noisy pictures smaller files than a set level, in half the time.
        return png(picture), ".png"
    return jpeg(picture, jpeg_quality), ".jpg"


def noisy(
    picture: NDArray[np.uint8], shot: float, read: float, gain: float, rng: np.random.Generator
) -> NDArray[np.uint8]:
    """The picture with the noise of one exposure; gain: how much it was brightened, 1 in good light.

    Light is level^2.2 of a gamma-coded picture. Its variance, shot^2 gain light + (read gain)^2, is converted to levels
    by the derivative of the inverse, level = light^(1/2.2).
    """
    level = np.maximum(np.arange(256) / 255.0, 0.02)
    sigma = np.sqrt(shot**2 * gain * level**_GAMMA + (read * gain) ** 2)
    grey_levels = (255.0 * sigma / (_GAMMA * level ** (_GAMMA - 1.0))).clip(0.0, 25.0).astype(np.float32)
    noise = rng.standard_normal(picture.shape, dtype=np.float32)
    noise *= np.asarray(cv2.LUT(picture, grey_levels))
    return np.asarray(cv2.add(noise, picture, dtype=cv2.CV_8U), dtype=np.uint8)


def shaken(mount: Mount, shake_rad: float, velocity: np.ndarray, rng: np.random.Generator) -> Mount:
    """The mount in one picture, with shake. velocity: forward m/s, left m/s, yaw rad/s of the base."""
    strength = min(1.0, abs(velocity[0]) / _SPEED_M_S + abs(velocity[2]) / _YAW_RATE_RAD_S)
    pitch, roll = rng.normal(0.0, 1.0, 2) * shake_rad * strength
    return replace(mount, pitch_rad=mount.pitch_rad + pitch, roll_rad=mount.roll_rad + roll)
