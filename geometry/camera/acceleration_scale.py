"""The scale of a camera's own motion: an accelerometer measures the same changes of velocity in metres."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

FEWEST = 8  # accelerations that tell a scale
ROUNDS, OUTLIER = 6, 2.0  # of reweighting; median errors beyond which an acceleration counts less
UNSURE_SHARE = 0.4  # of the difference between the lines of either direction


@dataclass(frozen=True, slots=True, eq=False)
class MovedStep:
    """One step of a base. span_s: its time. force: (2,) mean specific force ahead and to the left, levelled, m/s^2.
    yaw_rate: by the gyro, rad/s. velocity: (2,) by the odometry, base frame, m/s."""

    span_s: float
    force: Array
    yaw_rate: float
    velocity: Array


def accelerations(steps: Sequence[MovedStep], ends_s: float, arm_m: Array) -> Array:
    """Mean acceleration of the base over some steps by its odometry, (2,), and of the same by the accelerometer at the
    lens, arm_m (2,) ahead and to the left of the base's origin; (2, 2), base axes.

    The velocity's change is that between the means of the first and last `ends_s`; the force is weighted alike, by a
    trapezoid. In the turning base an acceleration is dv/dt + w x v, and the lens's has dw/dt x r - w^2 r more.
    """
    span = np.array([step.span_s for step in steps])
    force, velocity = (np.array([getattr(step, name) for step in steps]) for name in ("force", "velocity"))
    rate = np.array([step.yaw_rate for step in steps])
    end, total_s = np.cumsum(span), float(span.sum())
    first, last = (np.clip((ends_s - before) / span, 0.0, 1.0) * span for before in (end - span, total_s - end))
    change = (last / last.sum() - first / first.sum()) / (total_s - ends_s)
    weight = np.minimum(1.0, np.minimum(end - span / 2.0, total_s - end + span / 2.0) / ends_s) * span
    weight /= weight.sum()
    ahead_m, left_m = arm_m
    own = change @ velocity + [-(weight * rate) @ velocity[:, 1], (weight * rate) @ velocity[:, 0]]
    turning, spinning = weight @ rate**2, change @ rate
    return np.array(
        [own, weight @ force + [turning * ahead_m + spinning * left_m, turning * left_m - spinning * ahead_m]]
    )


def scale_of(pairs: Array) -> tuple[float, float] | None:
    """Logarithm of accelerometer over odometry and its standard deviation, of accelerations (N, 2, 2) as above; None
    for too few, or where one says nothing of the other.

    A line through both axes, each with an offset of its own (of sensor and tilt). The odometry's accelerations err more
    than the accelerometer's, so it is fitted from the latter to the former; how much the other way round differs counts
    as error.
    """
    if len(pairs) < FEWEST:
        return None
    weight = np.ones(len(pairs))
    for _ in range(ROUNDS):
        own, other = _centred(pairs, weight)
        squares, mixed = _product(own, own, weight), _product(own, other, weight)
        if mixed <= 0.0:
            return None
        off = np.linalg.norm(other - mixed / squares * own, axis=1)
        weight = np.minimum(1.0, OUTLIER * float(np.median(off)) / np.maximum(off, 1e-9))
    own, other = _centred(pairs, weight)
    squares, mixed, others = (_product(a, b, weight) for a, b in ((own, own), (own, other), (other, other)))
    variance = max(others - mixed**2 / squares, 0.0) / max(2.0 * float(weight.sum()) - 3.0, 1.0)
    slope, scale = mixed / squares, others / max(mixed, 1e-9)
    error = math.sqrt(variance / squares) / slope
    return math.log(scale), math.hypot(error, UNSURE_SHARE * math.log(scale / slope))


def _centred(pairs: Array, weight: Array) -> tuple[Array, Array]:
    own, other = np.moveaxis(pairs - np.average(pairs, axis=0, weights=weight), 1, 0)
    return own, other


def _product(a: Array, b: Array, weight: Array) -> float:
    return float(weight @ (a * b).sum(axis=1))
