"""What people add to a map besides its objects: zones, deletions and the dock."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal, TypeVar

import numpy as np

from edgemap.geometry.grid.rooms import Door, Room
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


Area = TypeVar("Area", Zone, Room)


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
        worst, reasons = max(self.level, other.level, key=LEVELS.index), dict.fromkeys(self.reasons + other.reasons)
        return replace(self.next(), level=worst, reasons=tuple(reasons))


@dataclass(frozen=True, slots=True)
class Annotations:
    """Annotations of a map. deleted: objects that a person has deleted, so that they stay deleted. dock: pose of the
    robot's base when it charges. vanished: objects that are no longer there, the latest last. identity: None of a list
    of objects that no run has made. rooms, doors: those of the saved map, and rooms that a person has named. last_pose:
    of the robot's base when the map was saved, None of a map that is being made.
    """

    zones: tuple[Zone, ...] = ()
    deleted: tuple[MapObject, ...] = ()
    dock: SE2 | None = None
    rooms: tuple[Room, ...] = ()
    doors: tuple[Door, ...] = ()
    vanished: tuple[MapObject, ...] = field(default=(), compare=False)
    identity: MapIdentity | None = field(default=None, compare=False)
    last_pose: SE2 | None = field(default=None, compare=False)

    def measured(self, saved: Sequence[MapObject]) -> list[MapObject]:
        """The measured objects of a saved map, deleted ones included, without edits."""
        plain = {"name": "", "confirmed": False, "corrected": (), "yaw_rad": None, "depth_m": None}
        return [replace(item, **plain) for item in (*saved, *self.deleted)]

    def with_areas(self, other: "Annotations", pose_map_other: SE2) -> "Annotations":
        """Another map's zones and named rooms added, in this one's frame and with the next free ids."""
        zones = (*self.zones, *_added(other.zones, self.zones, pose_map_other))
        rooms = _added([room for room in other.rooms if room.name], self.rooms, pose_map_other)
        return replace(self, zones=zones[:MAXIMUM_ZONES], rooms=(*self.rooms, *rooms))


NO_ANNOTATIONS = Annotations()


def _added(areas: Sequence[Area], taken: Sequence[Area], pose_map_other: SE2) -> Iterator[Area]:
    """Areas of another map in this one's frame, with the next free ids."""
    for number, area in enumerate(areas, 1 + max((id_order(one.id)[1] for one in taken), default=0)):
        corners_m = corners_of(pose_map_other.apply(np.array(area.corners_m)))
        yield replace(area, id=f"{id_order(area.id)[0]}-{number}", corners_m=corners_m)


def corners_of(points_m: np.ndarray) -> Corners:
    """Points (N, 2) as the corners of a polygon."""
    return tuple((float(x), float(y)) for x, y in points_m)
