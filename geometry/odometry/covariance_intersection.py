"""Fusion of several measurements of one motion: independent ones, correlated ones, and consensus among them."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from edgemap.geometry.arrays import Array
from edgemap.geometry.se2 import wrap_angle

GATE = 16.27  # squared Mahalanobis distance that holds 99.9 % of agreeing motions (chi-square, 3 degrees of freedom)
KNOWN_SIGMA = 0.1  # m and rad; a standard deviation beyond it counts for less where sources disagree
SHARES = np.linspace(0.0, 1.0, 6)  # tried by covariance intersection


@dataclass(frozen=True, slots=True, eq=False)
class MotionEstimate:
    """A motion (3,) in (m, m, rad), its covariance (3, 3). source: measurements of one source share their errors.

    conflict: sources that disagree beyond the gate, and what the covariance therefore covers; empty where they agree.
    members: names of the measurements that are in it.
    """

    motion: Array
    covariance: Array
    source: str
    conflict: str = ""
    members: frozenset[str] = frozenset()


def difference(a: MotionEstimate, b: MotionEstimate) -> Array:
    """Motion of b less that of a, (3,), the yaw round the circle."""
    offset = b.motion - a.motion
    offset[2] = wrap_angle(float(offset[2]))
    return offset


def distance(a: MotionEstimate, b: MotionEstimate) -> float:
    """Squared Mahalanobis distance of two measurements, assuming independent errors."""
    offset = difference(a, b)
    return float(offset @ np.linalg.solve(a.covariance + b.covariance, offset))


def fused(a: MotionEstimate, b: MotionEstimate) -> MotionEstimate:
    """Two measurements with independent errors, weighted by their information."""
    gain = np.linalg.solve(a.covariance + b.covariance, a.covariance).T
    covariance = a.covariance - gain @ a.covariance
    motion, source = a.motion + gain @ difference(a, b), f"{a.source}+{b.source}"
    return MotionEstimate(motion, (covariance + covariance.T) / 2.0, source, members=a.members | b.members)


def intersected(a: MotionEstimate, b: MotionEstimate) -> MotionEstimate:
    """Two measurements whose errors are correlated in an unknown way: covariance intersection.

    Julier and Uhlmann 1997; of a few shares the one with the smallest determinant. The result claims no more
    information than the better of the two.
    """
    one, other = np.linalg.inv(a.covariance), np.linalg.inv(b.covariance)
    mixed = SHARES[:, None, None] * other + (1.0 - SHARES)[:, None, None] * one
    best = int(np.argmax(np.linalg.det(mixed)))
    covariance = np.linalg.inv(mixed[best])
    motion = a.motion + SHARES[best] * covariance @ other @ difference(a, b)
    return MotionEstimate(motion, (covariance + covariance.T) / 2.0, a.source, members=a.members | b.members)


def consensus(estimates: Sequence[MotionEstimate]) -> MotionEstimate:
    """One motion of several measurements, the most trusted first: of the sets in which all pairs agree, the one with
    the largest number of SOURCES.

    Measurements of one source count once: their number decides only among sets of the same sources, then how well they
    agree. Of one source: by covariance intersection; of different sources: as independent. Where sets of different
    sources have equal rank, the sources disagree: the result lies between them and its covariance covers all.
    """
    if not estimates:
        raise ValueError("no measurements")
    if len(estimates) == 1:
        return estimates[0]
    distance2 = {
        pair: distance(estimates[pair[0]], estimates[pair[1]]) for pair in combinations(range(len(estimates)), 2)
    }
    best: dict[frozenset[str], tuple[tuple[int, float], tuple[int, ...]]] = {}
    for size in range(len(estimates), 0, -1):
        for chosen in combinations(range(len(estimates)), size):
            if all(distance2[pair] <= GATE for pair in combinations(chosen, 2)):
                sources = frozenset(estimates[index].source for index in chosen)
                rank = -size, sum(distance2[pair] for pair in combinations(chosen, 2))
                if sources not in best or rank < best[sources][0]:
                    best[sources] = rank, chosen
    maximum = max(len(sources) for sources in best)
    strongest = [_fused_set(estimates, chosen) for s, (_, chosen) in best.items() if len(s) == maximum]
    return strongest[0] if len(strongest) == 1 else _between(strongest)


def _fused_set(estimates: Sequence[MotionEstimate], chosen: tuple[int, ...]) -> MotionEstimate:
    """Fuses a set that agrees. A single member from which others of its source differ gets a covariance widened by the
    offset to the nearest of them."""
    estimate = _fused_by_source([estimates[index] for index in chosen])
    source = estimates[chosen[0]].source
    others = [m for i, m in enumerate(estimates) if i not in chosen and m.source == source]
    if len(chosen) > 1 or not others:
        return estimate
    offset = min((difference(estimate, other) for other in others), key=lambda vector: float(vector @ vector))
    return replace(estimate, covariance=estimate.covariance + np.outer(offset, offset) / 4.0)


def _between(sets: Sequence[MotionEstimate]) -> MotionEstimate:
    """Sets that disagree, one of which may be right: the moments of their mixture, each as likely as the others.

    Weights are by information and at most equal, so a set has no weight in what it does not measure (a gyro in
    translation).
    """
    sigmas = np.array([np.sqrt(np.diag(item.covariance)) for item in sets])
    weights = np.minimum(1.0, (KNOWN_SIGMA / sigmas) ** 2)
    weights = weights / weights.sum(axis=0)
    offsets = np.array([difference(sets[0], item) for item in sets])
    mean = (weights * offsets).sum(axis=0)
    deviations = np.sqrt(weights) * (offsets - mean)
    within = sum(np.sqrt(np.outer(w, w)) * item.covariance for w, item in zip(weights, sets, strict=True))
    names = sorted(item.source for item in sets)
    members = frozenset[str]().union(*(item.members for item in sets))
    return MotionEstimate(
        sets[0].motion + mean, within + deviations.T @ deviations, names[0], " against ".join(names), members
    )


def _fused_by_source(estimates: Sequence[MotionEstimate]) -> MotionEstimate:
    by_source: dict[str, MotionEstimate] = {}
    for item in estimates:
        earlier = by_source.get(item.source)
        by_source[item.source] = item if earlier is None else intersected(earlier, item)
    first, *others = by_source.values()
    for other in others:
        first = fused(first, other)
    return first
