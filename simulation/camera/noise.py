"""Sensor noise: shot noise grows with the root of the light, read noise is always there; both grow with the gain."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

_GAMMA = 2.2


def noise_levels(shot: float, read: float, gain: float) -> NDArray[np.float32]:
    """Standard deviation in grey levels for each of the 256 levels of a gamma-coded picture.

    Light is level^2.2; its variance, shot^2 gain light + (read gain)^2, comes back through the slope of the root.
    """
    level = np.maximum(np.arange(256) / 255.0, 0.02)
    sigma = np.sqrt(shot**2 * gain * level**_GAMMA + (read * gain) ** 2)
    return (255.0 * sigma / (_GAMMA * level ** (_GAMMA - 1.0))).clip(0.0, 25.0).astype(np.float32)


def noisy(
    picture: NDArray[np.uint8], shot: float, read: float, gain: float, rng: np.random.Generator
) -> NDArray[np.uint8]:
    """The picture with the noise of one exposure; gain: how much it was brightened, 1 in good light."""
    noise = rng.standard_normal(picture.shape, dtype=np.float32)
    noise *= np.asarray(cv2.LUT(picture, noise_levels(shot, read, gain)))
    return np.asarray(cv2.add(noise, picture, dtype=cv2.CV_8U), dtype=np.uint8)
