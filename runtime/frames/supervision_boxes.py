"""`Detections` to those of the package supervision, and back: its trackers, zones and annotators over our boxes."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from edgemap.geometry.observations.detections import Detections
from edgemap.runtime.frames.errors import MissingExtraError
from edgemap.runtime.frames.extras import pip

if TYPE_CHECKING:
    import supervision


def to_supervision(detections: Detections) -> "supervision.Detections":
    """The same boxes, scores and class numbers; the names are in `data["class_name"]`.

    Raises MissingExtraError where supervision is not installed.
    """
    try:
        import supervision
    except ImportError:
        raise MissingExtraError(f"supervision's detections need the package: {pip()} install supervision") from None

    return supervision.Detections(
        xyxy=detections.boxes.astype(np.float32),
        confidence=detections.scores.astype(np.float32),
        class_id=detections.class_ids.astype(int),
        data={"class_name": np.array(detections.labels, dtype=str)},
    )


def from_supervision(boxes: Any, names: Sequence[str] | None = None) -> Detections:
    """A `supervision.Detections` as ours, best score first; masks, tracks and other data are left out.

    names: of all classes; without them the boxes must have `class_name`. A box without a score gets 1.
    Raises ValueError where there are no class numbers, or neither names nor `class_name`, or a number has no name.
    """
    count = len(boxes.xyxy)
    if count and boxes.class_id is None:
        raise ValueError("supervision's detections without class_id: which class each box is must be known")
    class_ids = np.zeros(0, np.int64) if boxes.class_id is None else np.asarray(boxes.class_id, dtype=np.int64)
    if names is None:
        labels = boxes.data.get("class_name")
        if count and labels is None:
            raise ValueError("supervision's detections without class_name: pass names")
        known = {int(number): str(name) for number, name in zip(class_ids, labels if count else (), strict=True)}
        names = [known.get(number, "") for number in range(max(known, default=-1) + 1)]
    if count and not (class_ids.min() >= 0 and class_ids.max() < len(names)):
        raise ValueError(f"class_id {class_ids.min()} to {class_ids.max()} for {len(names)} names")
    scores = np.ones(count) if boxes.confidence is None else np.asarray(boxes.confidence, dtype=np.float64)
    order = np.argsort(-scores, kind="stable")
    return Detections(
        np.asarray(boxes.xyxy, dtype=np.float64).reshape(-1, 4)[order], scores[order], class_ids[order], tuple(names)
    )
