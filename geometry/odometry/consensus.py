"""Fusion of one motion's measurements by several sources: independent ones, and consensus among those that disagree."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import reduce
from itertools import combinations

import numpy as np

from edgemap.geometry.arrays import Array
from edgemap.geometry.se2 import wrap_angle

GATE = 16.27  # squared Mahalanobis distance that holds 99.9 % of agreeing motions (chi-square, 3 degrees of freedom)
KNOWN_SIGMA = 0.1  # m and rad; a standard deviation beyond it counts for less where sources disagree


@dataclass(frozen=True, slots=True, eq=False)
class MotionEstimate:
    """A motion (3,) in (m, m, rad), and its covariance (3, 3)."""

    motion: Array
    covariance: Array


@dataclass(frozen=True, slots=True, eq=False)
class Consensus(MotionEstimate):
    """A motion by several sources. sources: those that it uses. conflict: those that disagree beyond the gate, and whom
    the covariance therefore covers; empty where they agree."""

    sources: frozenset[str]
    conflict: str = ""


def difference(a: MotionEstimate, b: MotionEstimate) -> Array:
    """Motion of b less that of a, (3,), the yaw round the circle."""
    offset = b.motion - a.motion
    offset[2] = wrap_angle(float(offset[2]))
    return offset


def distance(a: MotionEstimate, b: MotionEstimate) -> float:
    """Squared Mahalanobis distance of two measurements with independent errors."""
    offset = difference(a, b)
    return float(offset @ np.linalg.solve(a.covariance + b.covariance, offset))


def fused(a: MotionEstimate, b: MotionEstimate) -> MotionEstimate:
    """Two measurements with independent errors, weighted by their information."""
    gain = np.linalg.solve(a.covariance + b.covariance, a.covariance).T
    covariance = a.covariance - gain @ a.covariance
    return MotionEstimate(a.motion + gain @ difference(a, b), (covariance + covariance.T) / 2.0)


def consensus(estimates: Mapping[str, MotionEstimate]) -> Consensus:
    """One motion of the measurements of several sources (one or more), whose errors are independent: that of the
    largest set of sources in which all pairs agree. Where several sets are as large, the sources disagree: the result
    lies between them and its covariance covers all.
    """
    apart = {pair for pair in combinations(estimates, 2) if distance(*(estimates[name] for name in pair)) > GATE}
    for size in range(len(estimates), 0, -1):
        sets = [names for names in combinations(estimates, size) if apart.isdisjoint(combinations(names, 2))]
        if sets:
            return _between(sets, [reduce(fused, (estimates[name] for name in names)) for names in sets])
    raise ValueError("no measurements")


def _between(sets: Sequence[Sequence[str]], motions: Sequence[MotionEstimate]) -> Consensus:
    """The motion of the only set, or of several, one of which may be right: the moments of their mixture, each as
    likely as the others.

    Weights are by information and at most equal, so a set has no weight in what it does not measure (a gyro in
    translation).
    """
    sources, first = frozenset(name for names in sets for name in names), motions[0]
    if len(sets) == 1:
        return Consensus(first.motion, first.covariance, sources)
    sigmas = np.array([np.sqrt(np.diag(item.covariance)) for item in motions])
    weights = np.minimum(1.0, (KNOWN_SIGMA / sigmas) ** 2)
    weights = weights / weights.sum(axis=0)
    offsets = np.array([difference(first, item) for item in motions])
    mean = (weights * offsets).sum(axis=0)
    deviations = np.sqrt(weights) * (offsets - mean)
    within = sum(np.sqrt(np.outer(w, w)) * item.covariance for w, item in zip(weights, motions, strict=True))
    conflict = " against ".join(sorted("+".join(names) for names in sets))
    return Consensus(first.motion + mean, within + deviations.T @ deviations, sources, conflict)
