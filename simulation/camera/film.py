"""From the renderer's picture to the camera's: shutter, noise, code, in the order in which they happen."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from edgemap.geometry.camera.intrinsics import Intrinsics
from edgemap.geometry.camera.mount import Mount
from edgemap.simulation.camera.noise import noisy
from edgemap.simulation.camera.setup import Effects
from edgemap.simulation.camera.shutter import exposed, optical_twist
from edgemap.simulation.render.mesh import Array


def sensed(
    picture: NDArray[np.uint8],
    depth_m: NDArray[np.float32],
    intrinsics: Intrinsics,
    mount: Mount,
    velocity: Array,
    effects: Effects,
    gain: float,
    rng: np.random.Generator,
) -> NDArray[np.uint8]:
    """Sensor model: applied to a picture (H, W, 3) that was rendered for the middle of its exposure.

    depth_m: (H, W) at that moment. velocity: of the base, forward m/s, left m/s, yaw rad/s. gain: how much the picture
    was brightened, 1 in good light.
    """
    if effects.exposure_s or effects.readout_s:
        twist = optical_twist(velocity, mount)
        picture = exposed(picture, depth_m, intrinsics, twist, effects.exposure_s, effects.readout_s)
    if effects.shot or effects.read:
        picture = noisy(picture, effects.shot, effects.read, gain, rng)
    return picture


def encoded(picture: NDArray[np.uint8], jpeg_quality: int | None) -> tuple[bytes, str]:
    """The picture as a file's bytes, and the file's suffix: PNG where no quality is given."""
    if jpeg_quality is None:
        # OpenCV's own choice of filter and runs: smaller files of noisy pictures than a stated level, in half the time.
        return cv2.imencode(".png", picture)[1].tobytes(), ".png"
    return cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, jpeg_quality])[1].tobytes(), ".jpg"
