"""Detected people and animals: odometry does not use features on them."""

import numpy as np
from numpy.typing import NDArray

from edgemap.geometry.observations.detections import Detections

MOVER_LABELS = frozenset(
    {"person", "cat", "dog", "bird", "horse", "sheep", "cow", "elephant", "bear", "zebra", "giraffe"}
)
GRID_PX = 16


def mover_boxes(detections: Detections) -> NDArray[np.float64]:
    """Boxes (M, 4), px of the camera's picture, of people and animals, whether they move now or not."""
    return detections.boxes[[label in MOVER_LABELS for label in detections.labels]]


def share_covered(boxes: NDArray[np.float64], width_px: int, height_px: int) -> float:
    """Share of a picture that boxes (M, 4), px, cover together, on a grid of GRID_PX."""
    seen = np.zeros((max(height_px // GRID_PX, 1), max(width_px // GRID_PX, 1)), dtype=np.bool_)
    for x0, y0, x1, y1 in np.maximum(np.rint(boxes / GRID_PX), 0.0).astype(np.intp).tolist():
        seen[y0:y1, x0:x1] = True
    return float(seen.mean())
