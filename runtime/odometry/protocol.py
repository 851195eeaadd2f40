"""What every odometry is to the pipeline: frames in, motion of the base with its covariance out."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from edgemap.geometry.se2 import SE2
from edgemap.runtime.bundle import Tensors
from edgemap.runtime.frame import Frame

Array = NDArray[np.float64]


def unknown_covariance() -> Array:
    """What an odometry says when it knows nothing of a step: 1 m and about 30 degrees, (3, 3)."""
    return np.diag([1.0, 1.0, 0.25])


@dataclass(frozen=True, slots=True, eq=False)
class Motion:
    """motion: of the BASE from the previous frame to this one. covariance: (3, 3) in (m, m, rad), in the previous
    base frame. fault: one line where the motion is a guess, else empty."""

    motion: SE2 = field(default_factory=SE2)
    covariance: Array = field(default_factory=unknown_covariance)
    fault: str = ""


class Odometry(Protocol):
    """Fed every frame in order. The first step after construction or a reset gives identity, covariance unknown."""

    name: str

    def step(self, frame: Frame, features: Tensors) -> Motion:
        """The motion since the frame of the previous step. features: the backbone's outputs of this frame."""
        ...

    def reset(self, reason: str) -> None:
        """Forget the past: a gap in the frames, another place."""
        ...
