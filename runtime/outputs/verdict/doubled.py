"""Objects that a continued map holds twice, because the run was placed wrongly in the saved one."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from edgemap.geometry.map_object import MapObject
from edgemap.geometry.registration.alignment import AlignmentError, align


class DoubledObjects:
    """Compares what a run has added to a saved map with what it has not observed there."""

    def __init__(self) -> None:
        self._compared = 0  # number of new objects, which are compared again when there are twice as many, or fewer
        self._seen: dict[str, Any] | None = None

    def seen(self, objects: Sequence[MapObject]) -> dict[str, Any] | None:
        """Where new objects stand to each other as unobserved ones of the saved map do, and chance does not explain it:
        their number, and how far they are from these, m and deg. None where more of the saved map was observed again.
        """
        saved = [item for item in objects if item.earlier]
        new = [item for item in objects if not item.earlier and all(e.what != "restored" for e in item.history)]
        if not self._compared <= len(new) < 2 * self._compared:
            self._compared, self._seen = len(new), _compared(saved, new)
        again = len(objects) - len(saved) - len(new)
        return self._seen if self._seen and self._seen["objects"] > again else None


def _compared(saved: Sequence[MapObject], new: Sequence[MapObject]) -> dict[str, Any] | None:
    try:
        alignment = align(saved, new)
    except AlignmentError:
        return None
    rows, columns = np.array(alignment.pairs).T
    away_m = np.array([saved[row].position_m for row in rows]) - [new[column].position_m for column in columns]
    return {
        "objects": len(rows),
        "away_m": round(float(np.linalg.norm(away_m, axis=1).mean()), 2),
        "turned_deg": round(float(np.degrees(abs(alignment.pose_a_b.yaw_rad))), 1),
    }
