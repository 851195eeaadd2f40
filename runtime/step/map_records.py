"""The records of a `map.json`: every value checked as it is read; its JSON Schema is made of them."""

from datetime import datetime
from typing import Annotated, Literal

import msgspec
from msgspec import Meta

from edgemap.geometry.map_object import EventKind, MapEvent
from edgemap.geometry.objects.annotations import LONGEST_NAME, MAXIMUM_CORNERS, MAXIMUM_ZONES, Level
from edgemap.geometry.se2 import SE2
from edgemap.runtime.frames.reading import HIDDEN, Coordinate, Name, Share, Size, Stamp

MAXIMUM_OBJECTS = 100_000
GivenName = Annotated[str, Meta(max_length=LONGEST_NAME, pattern=rf"\A[^{HIDDEN}]*\Z")]  # by a person
Point = tuple[Coordinate, Coordinate]
Yaw = Annotated[float, Meta(ge=-7.0, le=7.0)]  # radians
Utc = Annotated[datetime, Meta(tz=True)]
Variance = Annotated[float, Meta(ge=-1e6, le=1e6)]  # square metres


class HeadRecord(msgspec.Struct):
    """The file's format."""

    format: str = ""


class EventRecord(msgspec.Struct, kw_only=True):
    """An entry of an object's history; `at` is null where the wall time is unknown."""

    at: Utc | None = None
    what: EventKind
    by: Literal["sensor", "person"] = "sensor"
    from_m: Point | None = None
    to_m: Point | None = None
    other: Annotated[str, Meta(max_length=200, pattern=rf"\A[^{HIDDEN}]*\Z")] = ""

    @property
    def event(self) -> MapEvent:
        """The entry itself."""
        return MapEvent(self.what, seconds(self.at), self.by, self.from_m, self.to_m, self.other)


class VerdictRecord(msgspec.Struct, kw_only=True):
    """How far a map can be trusted, and why not further."""

    level: Level
    reasons: Annotated[list[str], Meta(max_length=100)] = []


class MapObjectRecord(msgspec.Struct, kw_only=True):
    """One object, map frame. Wall times are null where unknown."""

    id: Name
    label: Name
    x_m: Coordinate
    y_m: Coordinate
    covariance_m2: tuple[tuple[Variance, Variance], tuple[Variance, Variance]]
    width_m: Size
    height_m: Size
    count: Annotated[int, Meta(ge=1, le=1 << 40)]
    confidence: Share
    first_seen_s: Stamp
    last_seen_s: Stamp
    labels: Annotated[dict[Name, Share], Meta(max_length=1000)] = {}
    name: GivenName = ""
    confirmed: bool = False
    corrected: Annotated[list[Literal["label", "position", "size", "yaw"]], Meta(max_length=4)] = []
    yaw_rad: Yaw | None = None
    yaw_sigma_rad: Annotated[float, Meta(ge=0.0, le=7.0)] | None = None
    footprint: Annotated[list[Point], Meta(max_length=100)] = []
    depth_m: Size | None = None
    first_seen: Utc | None = None
    last_seen: Utc | None = None
    since: Utc | None = None
    earlier: bool = False
    history: Annotated[list[EventRecord], Meta(max_length=100)] = []


class PoseRecord(msgspec.Struct):
    """A pose, map frame."""

    x_m: Coordinate
    y_m: Coordinate
    yaw_rad: Yaw

    @property
    def pose(self) -> SE2:
        """The pose as an SE2."""
        return SE2(self.x_m, self.y_m, self.yaw_rad)


class ZoneRecord(msgspec.Struct, kw_only=True):
    """A zone drawn by a person."""

    id: Name
    name: GivenName
    corners_m: Annotated[list[Point], Meta(min_length=3, max_length=MAXIMUM_CORNERS)]


class RoomRecord(ZoneRecord, kw_only=True):
    """A room: its outline, the kind by its objects, its name by a person, and ids of its objects."""

    kind: Annotated[str, Meta(max_length=200)] = ""
    area_m2: Annotated[float, Meta(ge=0.0, le=1e9)] = 0.0
    objects: Annotated[list[Name], Meta(max_length=MAXIMUM_OBJECTS)] = []


class WallRecord(msgspec.Struct, kw_only=True):
    """One wall, a straight line."""

    from_m: Point
    to_m: Point


class DoorRecord(WallRecord, kw_only=True):
    """A door: its ends, the ids of its rooms, and the probability that it is open."""

    id: Name
    rooms: tuple[Name, Name]
    open: Share


class MapRecord(msgspec.Struct, kw_only=True):
    """The whole file."""

    format: Literal["edgemap.map/1"] = "edgemap.map/1"
    frame: str = "map"
    objects: Annotated[list[MapObjectRecord], Meta(max_length=MAXIMUM_OBJECTS)]
    zones: Annotated[list[ZoneRecord], Meta(max_length=MAXIMUM_ZONES)] = []
    grid: Name | None = None
    grid_sum: int | None = None
    walls: Annotated[list[WallRecord], Meta(max_length=100_000)] = []
    rooms: Annotated[list[RoomRecord], Meta(max_length=10_000)] = []
    doors: Annotated[list[DoorRecord], Meta(max_length=10_000)] = []
    deleted: Annotated[list[MapObjectRecord], Meta(max_length=MAXIMUM_OBJECTS)] = []
    seen_from_m: dict[Name, Annotated[list[Point], Meta(max_length=10_000)]] = {}
    dock: PoseRecord | None = None
    last_pose: PoseRecord | None = None
    map_id: Name | None = None
    generation: Annotated[int, Meta(ge=1, le=1 << 40)] = 1
    saved_at: Utc | None = None
    verdict: VerdictRecord | None = None
    vanished: Annotated[list[MapObjectRecord], Meta(max_length=1000)] = []


def seconds(at: datetime | None) -> float | None:
    """A wall time as seconds since 1970."""
    return None if at is None else at.timestamp()
