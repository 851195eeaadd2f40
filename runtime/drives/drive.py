"""A recorded drive in memory: where its pictures are and all that is known about them, whatever layout it came in."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from edgemap.geometry.intrinsics import Intrinsics
from edgemap.geometry.mount import Mount
from edgemap.runtime.trajectory import Trajectory


@dataclass(frozen=True, slots=True)
class LabelledBoxes:
    """True boxes of one picture: xyxy in px, shape (N, 4); class ids or names beside them, length N."""

    boxes: NDArray[np.float64]
    labels: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Drive:
    """One drive, read from any KIND of folder.

    images: in order of time. stamps_s: seconds, one per image. truth: poses of the base, seen from the first one.
    boxes: true boxes per image, empty where unknown. objects: records of `objects.json`. wheel: path of `wheel.csv`.
    """

    kind: str
    folder: Path
    images: tuple[Path, ...]
    stamps_s: NDArray[np.float64]
    intrinsics: Intrinsics | None = None
    mount: Mount | None = None
    rate_hz: float | None = None
    truth: Trajectory | None = None
    boxes: tuple[LabelledBoxes, ...] = ()
    objects: tuple[dict[str, Any], ...] = ()
    wheel: Path | None = None
    notes: dict[str, Any] = field(default_factory=dict)
