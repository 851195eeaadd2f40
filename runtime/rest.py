"""Whether a robot stands still, so that a frame brings nothing new: told by wheels and gyro, and by the picture."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from edgemap.runtime.frame import Frame
from edgemap.runtime.health import PictureHealth

Array = NDArray[np.float32]

SIZE = 64, 48  # px that pictures are averaged down to
SMALL_PX, LARGE_PX = 8, 16  # tiles of it, for what changes and for what shifts
TOLD_S, SEEN_S = 0.3, 2.0  # of unchanged pictures, where wheels or gyro say still too and where the picture alone does
LEAST_FRAMES = 3
CHANGED = 4.0  # grey levels, RMS in a small tile; a sensor's noise of 5 a pixel leaves 1.4
SHIFTED_PX, SIGMAS = 0.06, 4.0  # of a large tile, 0.6 px of a picture 640 px wide, beyond what noise explains
VARIANCE = 100.0  # squared grey levels; a picture of less is too plain to tell a gain
EXPOSURE, OFFSET = 0.1, 15.0  # largest change of gain, and of grey levels, that is taken for the camera's exposure
TEXTURE, TEXTURED = 9.0, 4  # squared grey levels per px, and how many large tiles must have that: else nothing shows


@dataclass(frozen=True, slots=True, eq=False)
class _Reference:
    """The first of unchanged pictures. centred: without its mean. across, down: its gradients."""

    stamp_s: float
    picture: Array
    centred: Array
    across: Array
    down: Array
    energy: Array
    variance: float
    textured: bool

    @classmethod
    def of(cls, picture: Array, stamp_s: float) -> _Reference:
        down, across = (np.asarray(slope, dtype=np.float32) for slope in np.gradient(picture))
        energy = np.stack([_tiles(across**2, LARGE_PX), _tiles(down**2, LARGE_PX)])
        textured = int((energy.min(axis=0) > TEXTURE).sum()) >= TEXTURED
        centred = picture - picture.mean()
        return cls(stamp_s, picture, centred, across, down, energy, float((centred**2).mean()), textured)


class RestMonitor:
    """Compares every picture with the first one that looked the same, so that no motion is too slow to be seen."""

    def __init__(self) -> None:
        self.reset()

    def judge(self, frame: Frame, health: PictureHealth, still: bool | None) -> bool:
        """Whether the robot has stood still for a while. still: what wheels and gyro say, None where there are none.

        A picture that is not to be trusted is none to rest by; one that is repeated changes nothing.
        """
        if health.stale:
            return False
        reference, picture = self._reference, _averaged(frame.image)
        if reference is None or health.blind or still is False or _moved(reference, picture):
            self._reference, self._frames = _Reference.of(picture, frame.stamp_s), 0
            return False
        self._frames += 1
        rested_s = frame.stamp_s - reference.stamp_s
        if still is None and not reference.textured:
            return False
        return self._frames >= LEAST_FRAMES and rested_s >= (TOLD_S if still else SEEN_S)

    def reset(self) -> None:
        """Forget the last picture."""
        self._reference: _Reference | None = None
        self._frames = 0


def _averaged(image: NDArray[np.uint8]) -> Array:
    half = np.ascontiguousarray(image[::2, ::2, 1])
    return np.asarray(cv2.resize(half, SIZE, interpolation=cv2.INTER_AREA), dtype=np.float32)


def _moved(reference: _Reference, picture: Array) -> bool:
    """Whether anything changed, or the picture shifted anywhere, by more than noise and exposure explain."""
    change = picture - reference.picture
    offset = float(change.mean())
    gain = float((change * reference.centred).mean()) / (reference.variance + VARIANCE)
    if abs(gain) > EXPOSURE or abs(offset) > OFFSET:
        return True
    change -= offset + gain * reference.centred
    squared = _tiles(change**2, SMALL_PX)
    if float(squared.max()) > CHANGED**2:
        return True
    noise = math.sqrt(float(np.median(squared)))
    slopes = np.stack([_tiles(change * reference.across, LARGE_PX), _tiles(change * reference.down, LARGE_PX)])
    shift = np.abs(slopes) / (reference.energy + TEXTURE)
    doubt = SIGMAS * noise / (LARGE_PX * np.sqrt(reference.energy + TEXTURE))
    return bool((shift > SHIFTED_PX + doubt).any())


def _tiles(values: Array, side: int) -> Array:
    """Mean of every square tile."""
    width, height = SIZE
    return values.reshape(height // side, side, width // side, side).mean(axis=(1, 3))
