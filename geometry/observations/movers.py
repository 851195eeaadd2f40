"""Detected things that move by themselves: what is seen on them tells nothing of the robot's own motion."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from edgemap.geometry.observations.detections import Detections

MOVER_LABELS = frozenset(
    {"person", "cat", "dog", "bird", "horse", "sheep", "cow", "elephant", "bear", "zebra", "giraffe"}
)


def mover_boxes(detections: Detections) -> NDArray[np.float64]:
    """Boxes (M, 4), px of the camera's picture, of people and animals, whether they move now or not."""
    return detections.boxes[[label in MOVER_LABELS for label in detections.labels]]
