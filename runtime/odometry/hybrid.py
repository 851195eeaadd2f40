"""Several odometries as one: a network, the floor's corners and wheels fail in different ways and mend each other."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from edgemap.geometry.odometry.covariance_intersection import MotionEstimate, consensus
from edgemap.geometry.se2 import SE2
from edgemap.runtime.bundle import Tensors
from edgemap.runtime.frame import Frame
from edgemap.runtime.odometry.protocol import Motion, Odometry


@dataclass(frozen=True, slots=True)
class Member:
    """An odometry within the hybrid. source: those of one source share their errors: `camera`, `wheels`.

    doubt: factor on its covariance, fitted on validation drives so that errors and covariance agree.
    """

    odometry: Odometry
    source: str
    doubt: float = 1.0


class HybridOdometry:
    """Believes what the most of its members agree on (`geometry.fusion.believed`); who reports a fault is left out.

    members: the most trusted first. Raises ValueError for none.
    """

    name = "hybrid"

    def __init__(self, members: Sequence[Member]) -> None:
        if not members:
            raise ValueError("a hybrid odometry needs members")
        self._members = tuple(members)
        self.reset("start")

    def step(self, frame: Frame, features: Tensors) -> Motion:
        """Every member's motion since the last frame, as one."""
        motions = [member.odometry.step(frame, features) for member in self._members]
        first, self._first = self._first, False
        alive = [
            MotionEstimate(motion.motion.vector(), member.doubt * motion.covariance, member.source)
            for member, motion in zip(self._members, motions, strict=True)
            if not motion.fault
        ]
        if first or not alive:
            return motions[0]
        found = consensus(alive)
        return Motion(SE2(*found.motion), np.asarray(found.covariance))

    def reset(self, reason: str) -> None:
        """Every member starts again."""
        for member in self._members:
            member.odometry.reset(reason)
        self._first = True
