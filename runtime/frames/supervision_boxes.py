"""`Detections` to those of the package supervision: its trackers, zones and annotators over our boxes."""

from typing import TYPE_CHECKING

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
