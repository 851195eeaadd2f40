"""Detects a robot at rest, so that its frames can be skipped: by wheels and gyro, and by the picture."""

import math
from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray

from edgemap.geometry.camera.attitude import GyroRotation
from edgemap.geometry.robust import CLEAR_SIGMAS
from edgemap.runtime.frames.faults import Fault, FaultKind
from edgemap.runtime.frames.frame import Frame
from edgemap.runtime.frames.timing import StreamTimer
from edgemap.runtime.motion.attitude.source import Moved
from edgemap.runtime.motion.health import MIDDLE_GREY, REPEATED_S, HealthRule, PictureHealth
from edgemap.runtime.motion.odometry.protocol import STILL

Array = NDArray[np.float32]

SIZE = 64, 48  # px that pictures are averaged down to
SMALL_PX, LARGE_PX = 8, 16  # tiles of it, for what changes and for what shifts
VARIANCE = 100.0  # squared grey levels; a picture of less is too plain to estimate a gain


@dataclass(frozen=True, slots=True)
class RestRule:
    """When a robot counts as standing: by wheels or gyro and an unchanged picture at once, by pictures alone once they
    have not changed for a while (`health.lasts_s`).
    """

    # Of a large tile (0.06 are 0.6 px of a picture 640 px wide), beyond what noise explains; -inf for a robot that
    # never stands.
    shifted_px: float = 0.06
    # Largest change of gain, and of brightness as a share of middle grey, attributed to the camera's exposure.
    exposure: float = 0.1
    # Squared grey levels per px, which a part of the picture (`health.part_share`) must have for a decision by pictures
    # alone.
    texture: float = 9.0
    # No small robot brakes harder (the limit of common controllers: 2.5). A picture that stays unchanged in spite of
    # that, or of a turn beyond the gyro's covariance, is frozen, even if a sensor's noise changes it.
    braking_m_s2: float = 3.0


class _Reference:
    """The first of unchanged pictures, and what was measured since.

    step_s: the step that ended at it. centred: the picture without its mean. since_s: stamp from which on the robot may
    stand. frozen: whether it cannot have stopped here. turned_rad, sigma_rad: by the gyro since, and its standard
    deviation.
    """

    def __init__(self, picture: Array, stamp_s: float, step_s: float) -> None:
        self.picture, self.stamp_s, self.step_s = picture, stamp_s, step_s
        self.centred = picture - picture.mean()
        self.variance = float((self.centred**2).mean())
        self.since_s, self.frozen = stamp_s, False
        self.turned_rad = self.sigma_rad = 0.0

    @cached_property
    def slopes(self) -> tuple[Array, Array]:
        """Its gradients across and down; computed only at rest."""
        down, across = (np.asarray(slope, dtype=np.float32) for slope in np.gradient(self.picture))
        return across, down

    @cached_property
    def energy(self) -> Array:
        """Mean squares of the gradients, (2, tiles)."""
        return np.stack([_tiles(slope**2, LARGE_PX) for slope in self.slopes])


class RestMonitor:
    """Compares every picture with the first one that matched it, so that even slow motion is detected."""

    def __init__(self, rule: RestRule | None = None, health: HealthRule | None = None) -> None:
        self.rule, self._health = rule or RestRule(), health or HealthRule()
        self._reference: _Reference | None = None
        self._before_s = self._last_s = -math.inf  # of the last frames
        self._news = StreamTimer(REPEATED_S)  # of a frozen picture

    def judge(
        self,
        frame: Frame,
        health: PictureHealth,
        still: bool | None,
        moved: Moved | None = None,
        turned: GyroRotation | None = None,
    ) -> tuple[bool, PictureHealth]:
        """Whether the robot has stood still for a while, and the picture's health: frozen where it stands still though
        the robot cannot. A blind picture gives no rest; a repeated one changes nothing.

        still: by wheels and gyro, None where there are none. moved: over the step before, None where it was not
        measured. turned: by the gyro since the frame before.
        """
        stamp_s = frame.stamp_s
        self._before_s, self._last_s = self._last_s, stamp_s
        if health.stale:
            return False, health
        reference, picture = self._reference, _averaged(frame.image)
        if reference is None or health.blind or _moved(reference, picture, self.rule, self._health.moved):
            self._reference = _Reference(picture, stamp_s, stamp_s - self._before_s)
            return False, health
        if still is not True and not reference.frozen:
            reference.frozen = self._must_move(stamp_s, reference, moved, turned)
        if reference.frozen:
            return False, self._frozen(reference.stamp_s, stamp_s)
        if still is False:
            reference.since_s = stamp_s
        lasts = stamp_s - reference.since_s >= self._health.lasts_s
        return still is True or (still is None and lasts and self._textured(reference)), health

    def _frozen(self, since_s: float, stamp_s: float) -> PictureHealth:
        """Frozen health for a good picture that has not changed since a stamp, except for noise, though the robot must
        move."""
        lasts = stamp_s - since_s >= self._health.lasts_s
        text = f"blind: picture frozen (shows the same since {since_s:.3f} s, but for noise, as the robot moves)"
        blindness = Fault(FaultKind.FROZEN if lasts else FaultKind.REPEATED, text)
        return PictureHealth(blindness, blindness if lasts and self._news.due(stamp_s) else None)

    def _must_move(
        self, stamp_s: float, reference: _Reference, moved: Moved | None, turned: GyroRotation | None
    ) -> bool:
        """Whether the robot moves in spite of an unchanged picture: by the gyro, or because it stopped too fast."""
        if turned is not None and turned.proved:  # samples that come late turn while the picture rests
            reference.turned_rad += turned.yaw_rad
            reference.sigma_rad += turned.sigma_rad  # its bias errs in every step alike
        must = abs(reference.turned_rad) > STILL + CLEAR_SIGMAS * reference.sigma_rad
        if moved is not None and reference.stamp_s == self._before_s:
            (x_m, y_m, _), sigma_m = moved[0].vector(), math.sqrt(float(np.trace(moved[1][:2, :2])))
            speed_m_s = (math.hypot(x_m, y_m) - sigma_m) / reference.step_s
            must |= speed_m_s > self.rule.braking_m_s2 * (stamp_s - reference.stamp_s)
        return must and self._textured(reference)

    def _textured(self, reference: _Reference) -> bool:
        """Whether enough of the picture shows a shift."""
        return float((reference.energy.min(axis=0) > self.rule.texture).mean()) >= self._health.part_share


def _averaged(image: NDArray[np.uint8]) -> Array:
    half = np.ascontiguousarray(image[::2, ::2, 1])
    return np.asarray(cv2.resize(half, SIZE, interpolation=cv2.INTER_AREA), dtype=np.float32)


def _moved(reference: _Reference, picture: Array, rule: RestRule, least: float) -> bool:
    """Whether anything changed by that many grey levels, or the picture shifted anywhere, by more than noise and
    exposure explain."""
    change = picture - reference.picture
    offset = float(change.mean())
    gain = float((change * reference.centred).mean()) / (reference.variance + VARIANCE)
    if abs(gain) > rule.exposure or abs(offset) > rule.exposure * MIDDLE_GREY:
        return True
    change -= offset + gain * reference.centred
    squared = _tiles(change**2, SMALL_PX)
    if float(squared.max()) > least**2:
        return True
    noise = math.sqrt(float(np.median(squared)))
    slopes = np.stack([_tiles(change * slope, LARGE_PX) for slope in reference.slopes])
    energy = reference.energy + rule.texture
    doubt = CLEAR_SIGMAS * noise / (LARGE_PX * np.sqrt(energy))
    return bool((np.abs(slopes) / energy > rule.shifted_px + doubt).any())


def _tiles(values: Array, side: int) -> Array:
    """Mean of every square tile."""
    width, height = SIZE
    return values.reshape(height // side, side, width // side, side).mean(axis=(1, 3))
