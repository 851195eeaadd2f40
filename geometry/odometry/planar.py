"""Planar motion from tracked floor points: RANSAC over SE(2)."""

import math

import numpy as np
from numpy.typing import NDArray

from edgemap.geometry.se2 import SE2

Array = NDArray[np.float64]


def fit_se2(from_m: Array, to_m: Array, weights: Array) -> SE2:
    """The SE2 that best takes points (N, 2) to points (N, 2): weighted least squares, closed form.

    Two-dimensional case of Umeyama (1991) without scale. Needs two points that do not coincide.
    """
    share = weights / weights.sum()
    centre_from, centre_to = share @ from_m, share @ to_m
    a, b = from_m - centre_from, to_m - centre_to
    yaw = math.atan2(
        float((share * (a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])).sum()), float((share[:, None] * a * b).sum())
    )
    shift = centre_to - SE2(0.0, 0.0, yaw).apply(centre_from)
    return SE2(shift[0], shift[1], yaw)


def planar_motion(
    previous_m: Array, current_m: Array, sigmas_m: Array, rng: np.random.Generator, rounds: int = 64
) -> SE2 | None:
    """Motion of the base from static floor points observed before and after: previous = motion . current.

    previous_m, current_m: (N, 2) in the base frame of each time. sigmas_m: (N,) standard deviation of a pair's
    residual. None where fewer than six points agree.
    """
    count = len(previous_m)
    if count < 6:
        return None
    first = rng.integers(0, count, rounds)
    second = (first + rng.integers(1, count, rounds)) % count
    span_previous = previous_m[second] - previous_m[first]
    span_current = current_m[second] - current_m[first]
    yaw = np.arctan2(span_previous[:, 1], span_previous[:, 0]) - np.arctan2(span_current[:, 1], span_current[:, 0])
    c, s = np.cos(yaw)[:, None], np.sin(yaw)[:, None]
    middle_previous, middle_current = ((points[first] + points[second]) / 2.0 for points in (previous_m, current_m))
    x = c * (current_m[:, 0] - middle_current[:, :1]) - s * (current_m[:, 1] - middle_current[:, 1:])
    y = s * (current_m[:, 0] - middle_current[:, :1]) + c * (current_m[:, 1] - middle_current[:, 1:])
    residual2 = (x + middle_previous[:, :1] - previous_m[:, 0]) ** 2 + (
        y + middle_previous[:, 1:] - previous_m[:, 1]
    ) ** 2
    agreeing = residual2 < (3.0 * sigmas_m) ** 2
    long_enough = (span_previous**2).sum(axis=1) > 0.05**2
    votes = (agreeing.sum(axis=1)) * long_enough
    best = int(votes.argmax())
    if votes[best] < 6:
        return None
    inliers = agreeing[best]
    weights = 1.0 / sigmas_m**2
    motion = SE2()
    for _ in range(3):
        motion = fit_se2(current_m[inliers], previous_m[inliers], weights[inliers])
        residual = previous_m - motion.apply(current_m)
        inliers = (residual**2).sum(axis=1) < (3.0 * sigmas_m) ** 2
        if inliers.sum() < 6:
            return None
    return motion
