"""What people add to a map besides its objects: zones, deletions and the dock."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from edgemap.geometry.map_object import MapObject, id_order
from edgemap.geometry.se2 import SE2

Corners = tuple[tuple[float, float], ...]

MAXIMUM_CORNERS, MAXIMUM_ZONES, LONGEST_NAME = 100, 200, 80
Level = Literal["good", "care", "unreliable"]
LEVELS: tuple[Level, ...] = ("good", "care", "unreliable")


@dataclass(frozen=True, slots=True)
class Zone:
    """A named part of the floor. corners_m: its polygon in the map frame, at least three."""

    id: str
    name: str
    corners_m: Corners


@dataclass(frozen=True, slots=True)
class MapIdentity:
    """Which map it is. map_id: made once. generation: 1 for the run that made it, one more for each run that continued
    it. saved_at: seconds since 1970, None where unknown. level, reasons: how far the run that saved it can be trusted;
    None of an older map.
    """

    map_id: str
    generation: int = 1
    saved_at: float | None = None
    level: Level | None = None
    reasons: tuple[str, ...] = ()

    def next(self) -> "MapIdentity":
        """Of a run or command that goes on with the map."""
        return MapIdentity(self.map_id, self.generation + 1)

    def merged(self, other: "MapIdentity | None") -> "MapIdentity":
        """Of this map with another one merged into it: no better than either."""
        if other is None or other.level is None or self.level is None:
            return self.next()
        worst = max(self.level, other.level, key=LEVELS.index)
        return replace(self.next(), level=worst, reasons=tuple(dict.fromkeys(self.reasons + other.reasons)))


@dataclass(frozen=True, slots=True)
class Annotations:
    """Annotations of a map. deleted: objects that a person has deleted, so that they stay deleted. dock: pose of the
    robot's base when it charges. vanished: objects that are no longer there, the latest last. identity: None of a list
    of objects that no run has made.
    """

    zones: tuple[Zone, ...] = ()
    deleted: tuple[MapObject, ...] = ()
    dock: SE2 | None = None
    vanished: tuple[MapObject, ...] = field(default=(), compare=False)
    identity: MapIdentity | None = field(default=None, compare=False)

    def measured(self, saved: Sequence[MapObject]) -> list[MapObject]:
        """The measured objects of a saved map, deleted ones included, without edits."""
        plain = {"name": "", "confirmed": False, "corrected": (), "yaw_rad": None, "depth_m": None}
        return [replace(item, **plain) for item in (*saved, *self.deleted)]

    def judged(self, level: Level, reasons: Sequence[str]) -> "Annotations":
        """With how far the map can be trusted, and why not further."""
        if self.identity is None:
            return self
        return replace(self, identity=replace(self.identity, level=level, reasons=tuple(reasons)))

    def with_zones(self, zones: Sequence[Zone], pose_map_other: SE2) -> "Annotations":
        """Another map's zones added, in this one's frame and with the next free ids."""
        last = max((id_order(zone.id)[1] for zone in self.zones), default=0)
        added = (
            Zone(f"zone-{number}", zone.name, corners_of(pose_map_other.apply(np.array(zone.corners_m))))
            for number, zone in enumerate(zones, last + 1)
        )
        return replace(self, zones=(*self.zones, *added)[:MAXIMUM_ZONES])


NO_ANNOTATIONS = Annotations()


def corners_of(points_m: np.ndarray) -> Corners:
    """Points (N, 2) as the corners of a polygon."""
    return tuple((float(x), float(y)) for x, y in points_m)
