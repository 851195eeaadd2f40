"""What people add to a map besides its objects: zones, deletions and the dock."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from edgemap.geometry.grid.rooms import Door, Room
from edgemap.geometry.map_object import Ids, MapObject, Place, as_places, id_order
from edgemap.geometry.se2 import SE2

Corners = tuple[Place, ...]

ADDED = "-added"  # between label and number of the id of an object that a person has added
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
        """The measured objects of a saved map, deleted ones included, without edits; none that a person has added."""
        plain = {"name": "", "confirmed": False, "corrected": (), "yaw_rad": None, "depth_m": None}
        return [replace(item, **plain) for item in (*saved, *self.deleted) if ADDED not in item.id]

    def with_areas(self, other: "Annotations") -> "Annotations":
        """Another map's zones and named rooms added, with the next free ids."""
        ids, named = Ids(area.id for area in (*self.zones, *self.rooms)), [room for room in other.rooms if room.name]
        zones, rooms = (
            tuple(replace(area, id=ids.new(id_order(area.id)[0])) for area in areas) for areas in (other.zones, named)
        )
        return replace(self, zones=(*self.zones, *zones)[:MAXIMUM_ZONES], rooms=(*self.rooms, *rooms))

    def transformed(self, pose: SE2, factor: float = 1.0) -> "Annotations":
        """As `MapObject.transformed`."""

        def at(points_m: Corners) -> Corners:
            return as_places(pose.apply(factor * np.array(points_m)))

        zones, rooms = (
            tuple(replace(area, corners_m=at(area.corners_m)) for area in areas) for areas in (self.zones, self.rooms)
        )
        ends = ((door, *at((door.from_m, door.to_m))) for door in self.doors)
        doors = tuple(replace(door, from_m=from_m, to_m=to_m) for door, from_m, to_m in ends)
        dock = self.dock and pose @ self.dock.scaled(factor)
        deleted, vanished = (
            tuple(item.transformed(pose, factor) for item in items) for items in (self.deleted, self.vanished)
        )
        return replace(self, zones=zones, deleted=deleted, dock=dock, rooms=rooms, doors=doors, vanished=vanished)


NO_ANNOTATIONS = Annotations()
