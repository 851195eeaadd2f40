"""The detections of one picture, and the share of it that people and animals cover."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

MOVER_LABELS = frozenset(
    {"person", "cat", "dog", "bird", "horse", "sheep", "cow", "elephant", "bear", "zebra", "giraffe"}
)


@dataclass(frozen=True, slots=True, eq=False)
class Detections:
    """Boxes of one picture, best score first.

    boxes: (N, 4) float64, x0 y0 x1 y1 in px of the camera's picture, counted from the outer edge of its first pixel
    as detectors and COCO do (the lens counts from that pixel's centre: half a pixel less). scores: (N,) in 0..1.
    class_ids: (N,) int, indices into `names`. Raises ValueError where the shapes disagree.
    """

    boxes: NDArray[np.float64]
    scores: NDArray[np.float64]
    class_ids: NDArray[np.int64]
    names: tuple[str, ...]

    def __post_init__(self) -> None:
        count = len(self.scores)
        if self.boxes.shape != (count, 4) or self.class_ids.shape != (count,):
            raise ValueError(f"detections: boxes {self.boxes.shape}, scores {count}, classes {self.class_ids.shape}")

    def __len__(self) -> int:
        return len(self.scores)

    @property
    def labels(self) -> list[str]:
        """Class name of each box."""
        return [self.names[i] for i in self.class_ids]

    @classmethod
    def none(cls, names: tuple[str, ...]) -> "Detections":
        """No boxes."""
        return cls(np.zeros((0, 4)), np.zeros(0), np.zeros(0, dtype=np.int64), names)


def mover_boxes(detections: Detections) -> NDArray[np.float64]:
    """Boxes (M, 4), px of the camera's picture, of people and animals, whether they move now or not."""
    return detections.boxes[[label in MOVER_LABELS for label in detections.labels]]


def share_covered(boxes: NDArray[np.float64], width_px: int, height_px: int) -> float:
    """Share of a picture that boxes (M, 4), px, cover together, on a grid of 16 px."""
    cell_px = 16
    seen = np.zeros((max(height_px // cell_px, 1), max(width_px // cell_px, 1)), dtype=np.bool_)
    for x0, y0, x1, y1 in np.maximum(np.rint(boxes / cell_px), 0.0).astype(np.intp).tolist():
        seen[y0:y1, x0:x1] = True
    return float(seen.mean())
