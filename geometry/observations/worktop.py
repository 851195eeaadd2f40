"""Worktops that a floor mask takes for floor: what people put on furniture stands on them."""

import numpy as np

from edgemap.geometry.observations.detections import Detections
from edgemap.geometry.observations.floor_mask import FloorMask

# Things that hardly ever stand on a floor.
WORKTOP_LABELS = frozenset(
    {"laptop", "book", "wine glass", "cup", "bowl", "microwave", "toaster", "keyboard", "mouse", "remote", "cell phone",
     "fork", "knife", "spoon", "scissors", "toothbrush", "banana", "apple", "sandwich", "orange", "broccoli", "carrot",
     "hot dog", "pizza", "donut", "cake"}
)  # fmt: skip


def is_worktop(mask: FloorMask | None, detections: Detections) -> bool:
    """Whether one of these things stands on what the mask takes for floor, by the middle of its box's lower edge."""
    boxes = detections.boxes[[label in WORKTOP_LABELS for label in detections.labels]]
    if mask is None or not len(boxes):
        return False
    rows, columns = mask.floor.shape
    column = np.clip((boxes[:, 0] + boxes[:, 2]) / 2.0 * columns / mask.width, 0, columns - 1).astype(np.intp)
    row = np.clip(boxes[:, 3] * rows / mask.height, 0, rows - 1).astype(np.intp)
    return bool((mask.floor[row, column] >= 0.5).any())
