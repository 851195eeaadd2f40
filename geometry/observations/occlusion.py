"""Which boxes stand on the floor, and how much of a box's lower edge other boxes may hide."""

import numpy as np
from numpy.typing import NDArray

from edgemap.geometry.arrays import Array
from edgemap.geometry.observations.detections import Detections

# Classes of small objects that stand on furniture.
WORKTOP_LABELS = frozenset(
    {"laptop", "book", "wine glass", "cup", "bowl", "microwave", "toaster", "keyboard", "mouse", "remote", "cell phone",
     "fork", "knife", "spoon", "scissors", "toothbrush", "banana", "apple", "sandwich", "orange", "broccoli", "carrot",
     "hot dog", "pizza", "donut", "cake"}
)  # fmt: skip
BAG_LABELS = frozenset({"backpack", "handbag", "suitcase"})  # people carry them, too
# What people put on furniture; on the floor only where no furniture is seen under it.
TABLETOP_LABELS = (
    WORKTOP_LABELS | BAG_LABELS | {"vase", "potted plant", "tv", "bottle", "clock", "teddy bear", "hair drier", "sink"}
)
SUPPORT_LABELS = frozenset({"dining table", "couch", "bed", "bench", "oven", "refrigerator", "chair", "sink"})

EDGE_PX = 3.0  # by which an edge of a box may be off: lower by more is nearer, and nearer to the border may be cut


def carried(detections: Detections) -> NDArray[np.bool_]:
    """Tabletop objects and bags on furniture, and bags on people: their lower edge lies inside that box, well above its
    feet; (N,)."""
    listed, (left, top, right, bottom) = detections.labels, detections.boxes.T
    tabletop, support, bag = (
        np.array([label in names for label in listed], dtype=np.bool_)
        for names in (TABLETOP_LABELS, SUPPORT_LABELS, BAG_LABELS)
    )
    labels = np.array(listed, dtype=np.str_)
    may = tabletop[:, None] & (support | (bag[:, None] & (labels == "person"))) & (labels[:, None] != labels)
    middle, foot, width = ((left + right) / 2.0)[:, None], bottom[:, None], right - left
    above = (left <= middle) & (middle <= right) & (width > width[:, None])
    inside = (top <= foot) & (foot <= bottom - 0.15 * (bottom - top))
    return np.asarray((may & above & inside).any(axis=1), dtype=np.bool_)


def covered(boxes: Array, row: int) -> float:
    """Share of a box's lower edge, 0..1, that lies inside boxes (N, 4) of objects standing nearer: what may hide it."""
    x0, _, x1, y1 = boxes[row]
    nearer = (boxes[:, 3] > y1 + EDGE_PX) & (boxes[:, 1] < y1)
    left, right = np.clip(boxes[nearer, 0], x0, x1), np.clip(boxes[nearer, 2], x0, x1)
    hidden_px, reached = 0.0, x0
    for start, end in sorted(zip(left.tolist(), right.tolist(), strict=True)):
        hidden_px += max(0.0, end - max(start, reached))
        reached = max(reached, end)
    return hidden_px / max(x1 - x0, 1e-9)
