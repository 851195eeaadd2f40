"""The detections of one picture."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


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
