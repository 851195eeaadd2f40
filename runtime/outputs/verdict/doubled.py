"""Objects that a map holds twice, because a person has placed the robot wrongly in it."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from edgemap.geometry.map_object import MapObject
from edgemap.geometry.registration.alignment import AlignmentError, align


class DoubledObjects:
    """Compares what a run has added since the robot was placed with what it has not observed again.

    since_s: stamp at which a person set the pose; by default the run's start in a saved map.
    """

    def __init__(self, since_s: float = -math.inf) -> None:
        self._since_s = since_s
        self._compared = 0  # number of new objects, which are compared again when there are twice as many, or fewer
        self._seen: dict[str, Any] | None = None

    def ended(self) -> None:
        """The map is complete: it is compared once more."""
        self._compared = 0

    def seen(self, objects: Sequence[MapObject], vanished: Sequence[MapObject] = ()) -> dict[str, Any] | None:
        """Where new objects stand to each other as earlier, unobserved ones do or did, and chance does not explain it:
        their number, and how far they are from these, m and deg. None where more of the earlier ones were observed
        again. vanished: what this run has removed, as the floor is free where it would stand.
        """
        old = [item for item in objects if item.earlier or item.last_seen_s < self._since_s]
        new = [item for item in objects if not item.earlier and item.first_seen_s >= self._since_s]
        new = [item for item in new if all(event.what != "restored" for event in item.history)]
        again = len(objects) - len(old) - len(new)
        if (fewer := len(new) < self._compared) or len(new) >= 2 * self._compared:
            gone = [item for item in vanished if item.earlier or item.last_seen_s < self._since_s]
            before = None if fewer else self._seen  # which was so while more of the earlier ones were on the map
            self._compared, self._seen = len(new), _compared([*old, *gone], new) or before
        return self._seen if self._seen and self._seen["objects"] > again else None


def _compared(old: Sequence[MapObject], new: Sequence[MapObject]) -> dict[str, Any] | None:
    try:
        alignment = align(old, new)
    except AlignmentError:
        return None
    rows, columns = np.array(alignment.pairs).T
    away_m = np.array([old[row].position_m for row in rows]) - [new[column].position_m for column in columns]
    return {
        "objects": len(rows),
        "away_m": round(float(np.linalg.norm(away_m, axis=1).mean()), 2),
        "turned_deg": round(float(np.degrees(abs(alignment.pose_a_b.yaw_rad))), 1),
    }
