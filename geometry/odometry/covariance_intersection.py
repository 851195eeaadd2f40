"""Several measurements of one motion as one: independent ones, ones that share their errors, and whom to believe."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from edgemap.geometry.se2 import wrap_angle

Array = NDArray[np.float64]

GATE = 16.27  # squared Mahalanobis distance that holds 99.9 % of agreeing motions (chi-square, 3 degrees of freedom)
SHARES = np.linspace(0.0, 1.0, 6)  # tried by covariance intersection


@dataclass(frozen=True, slots=True, eq=False)
class MotionEstimate:
    """A motion (3,) in (m, m, rad), its covariance (3, 3). source: measurements of one source share their errors."""

    motion: Array
    covariance: Array
    source: str


def difference(a: MotionEstimate, b: MotionEstimate) -> Array:
    """Motion of b less that of a, (3,), the yaw round the circle."""
    found = b.motion - a.motion
    found[2] = wrap_angle(float(found[2]))
    return found


def distance(a: MotionEstimate, b: MotionEstimate) -> float:
    """Squared Mahalanobis distance of two measurements, their errors taken for independent."""
    apart = difference(a, b)
    return float(apart @ np.linalg.solve(a.covariance + b.covariance, apart))


def fused(a: MotionEstimate, b: MotionEstimate) -> MotionEstimate:
    """Two measurements with independent errors, weighted by their information."""
    gain = np.linalg.solve(a.covariance + b.covariance, a.covariance).T
    covariance = a.covariance - gain @ a.covariance
    return MotionEstimate(
        a.motion + gain @ difference(a, b), (covariance + covariance.T) / 2.0, f"{a.source}+{b.source}"
    )


def intersected(a: MotionEstimate, b: MotionEstimate) -> MotionEstimate:
    """Two measurements whose errors are correlated in an unknown way: covariance intersection.

    Julier and Uhlmann 1997; the share with the smallest determinant of a few. Never surer than the surer one is.
    """
    one, other = np.linalg.inv(a.covariance), np.linalg.inv(b.covariance)
    mixed = SHARES[:, None, None] * other + (1.0 - SHARES)[:, None, None] * one
    best = int(np.argmax(np.linalg.det(mixed)))
    covariance = np.linalg.inv(mixed[best])
    motion = a.motion + SHARES[best] * covariance @ other @ difference(a, b)
    return MotionEstimate(motion, (covariance + covariance.T) / 2.0, a.source)


def consensus(measured: Sequence[MotionEstimate], gate: float = GATE) -> MotionEstimate:
    """One motion of several measurements, the most trusted first: of the largest set in which all pairs agree.

    Sets of one size: the one that agrees best; single ones: the first, and the nearest other one's difference is its
    doubt. Of one source: by covariance intersection; of different sources: as independent.
    """
    if not measured:
        raise ValueError("no measurement to believe")
    apart = {pair: distance(measured[pair[0]], measured[pair[1]]) for pair in combinations(range(len(measured)), 2)}
    for size in range(len(measured), 1, -1):
        sets = [chosen for chosen in combinations(range(len(measured)), size) if _agree(chosen, apart, gate)]
        if sets:
            best = min(sets, key=lambda chosen: sum(apart[pair] for pair in combinations(chosen, 2)))
            return _joined([measured[index] for index in best])
    first = measured[0]
    if len(measured) == 1:
        return first
    doubts = [difference(first, other) for other in measured[1:]]
    doubt = min(doubts, key=lambda vector: float(vector @ vector))
    return MotionEstimate(first.motion, first.covariance + np.outer(doubt, doubt) / 4.0, first.source)


def _agree(chosen: tuple[int, ...], apart: dict[tuple[int, int], float], gate: float) -> bool:
    return all(apart[pair] <= gate for pair in combinations(chosen, 2))


def _joined(measured: Sequence[MotionEstimate]) -> MotionEstimate:
    by_source: dict[str, MotionEstimate] = {}
    for item in measured:
        known = by_source.get(item.source)
        by_source[item.source] = item if known is None else intersected(known, item)
    first, *others = by_source.values()
    for other in others:
        first = fused(first, other)
    return first
