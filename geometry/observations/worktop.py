"""Worktops that a floor mask mistakes for floor: small things of furniture stand on them."""

from edgemap.geometry.observations.detections import Detections
from edgemap.geometry.observations.floor_mask import FloorMask
from edgemap.geometry.observations.sighting import feet_px

# Classes of small things that people keep on furniture.
WORKTOP_LABELS = frozenset(
    {"laptop", "book", "wine glass", "cup", "bowl", "microwave", "toaster", "keyboard", "mouse", "remote", "cell phone",
     "fork", "knife", "spoon", "scissors", "toothbrush", "banana", "apple", "sandwich", "orange", "broccoli", "carrot",
     "hot dog", "pizza", "donut", "cake"}
)  # fmt: skip


def is_worktop(mask: FloorMask | None, detections: Detections) -> bool:
    """Whether the mask is floor where an object of these classes stands: at the middle of its box's lower edge."""
    small = [label in WORKTOP_LABELS for label in detections.labels]
    return mask is not None and any(small) and bool((mask.at(feet_px(detections)[small]) >= 0.5).any())
