"""Several odometries as one: the floor's corners and the wheels see different things, so each mends the other."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from edgemap.geometry.se2 import SE2, wrap_angle
from edgemap.runtime.frame import Frame
from edgemap.runtime.odometry.protocol import Motion, Odometry
from edgemap.runtime.session import Tensors

Array = NDArray[np.float64]

GATE = 16.27  # squared Mahalanobis distance that holds 99.9 % of agreeing motions (chi-square, 3 degrees of freedom)


class HybridOdometry:
    """Fuses the motions of its members step by step; one that reports a fault is left out while another goes on.

    members: the most trusted last: where two disagree beyond the gate, the later one is believed, and doubted. Their
    errors are taken for independent, which holds for camera and wheels, not for two readings of the same pictures.
    """

    name = "hybrid"

    def __init__(self, members: Sequence[Odometry]) -> None:
        self._members = tuple(members)
        self.reset("start")

    def step(self, frame: Frame, features: Tensors) -> Motion:
        """Every member's motion since the last frame, as one."""
        motions = [member.step(frame, features) for member in self._members]
        first, self._first = self._first, False
        alive = [motion for motion in motions if not motion.fault]
        if first or not alive:
            return motions[0]
        fused = alive[0]
        for motion in alive[1:]:
            fused = fuse(fused, motion)
        return fused

    def reset(self, reason: str) -> None:
        """Every member starts again."""
        for member in self._members:
            member.reset(reason)
        self._first = True


def fuse(a: Motion, b: Motion) -> Motion:
    """Two independent measurements of one motion: weighted by information where they agree, else b with doubt."""
    difference = b.motion.vector() - a.motion.vector()
    difference[2] = wrap_angle(float(difference[2]))
    total = a.covariance + b.covariance
    if difference @ np.linalg.solve(total, difference) > GATE:
        return replace(b, covariance=b.covariance + np.outer(difference, difference) / 4.0)
    gain = np.linalg.solve(total, a.covariance).T
    x_m, y_m, yaw_rad = a.motion.vector() + gain @ difference
    covariance = a.covariance - gain @ a.covariance
    return Motion(SE2(x_m, y_m, yaw_rad), (covariance + covariance.T) / 2.0)
