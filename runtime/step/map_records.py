"""The records of a `map.json`: every value checked as it is read."""

from typing import Annotated, Literal

import msgspec
from msgspec import Meta

from edgemap.geometry.objects.annotations import LONGEST_NAME, MAXIMUM_CORNERS, MAXIMUM_ZONES
from edgemap.geometry.se2 import SE2
from edgemap.runtime.frames.reading import HIDDEN, Coordinate, Name, Share, Size, Stamp

MAXIMUM_OBJECTS = 100_000
GivenName = Annotated[str, Meta(max_length=LONGEST_NAME, pattern=rf"\A[^{HIDDEN}]*\Z")]  # by a person
Yaw = Annotated[float, Meta(ge=-7.0, le=7.0)]  # radians
Variance = Annotated[float, Meta(ge=-1e6, le=1e6)]  # square metres


class HeadRecord(msgspec.Struct):
    """The file's format."""

    format: str = ""


class LastPoseRecord(msgspec.Struct):
    """The pose at which the run that wrote the file ended."""

    last_pose: "PoseRecord | None" = None


class MapObjectRecord(msgspec.Struct, kw_only=True):
    """One object, map frame."""

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
    labels: Annotated[dict[Name, Share], Meta(max_length=1000)] = msgspec.field(default_factory=dict)
    name: GivenName = ""
    confirmed: bool = False
    corrected: Annotated[list[Literal["label", "position", "size", "yaw"]], Meta(max_length=4)] = msgspec.field(
        default_factory=list
    )
    yaw_rad: Yaw | None = None
    depth_m: Size | None = None


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
    corners_m: Annotated[list[tuple[Coordinate, Coordinate]], Meta(min_length=3, max_length=MAXIMUM_CORNERS)]


class WallRecord(msgspec.Struct, kw_only=True):
    """One wall, a straight line."""

    from_m: tuple[Coordinate, Coordinate]
    to_m: tuple[Coordinate, Coordinate]


class MapRecord(msgspec.Struct, kw_only=True):
    """The whole file."""

    objects: Annotated[list[MapObjectRecord], Meta(max_length=MAXIMUM_OBJECTS)]
    zones: Annotated[list[ZoneRecord], Meta(max_length=MAXIMUM_ZONES)] = msgspec.field(default_factory=list)
    grid: Name | None = None
    walls: Annotated[list[WallRecord], Meta(max_length=100_000)] = msgspec.field(default_factory=list)
    deleted: Annotated[list[MapObjectRecord], Meta(max_length=MAXIMUM_OBJECTS)] = msgspec.field(default_factory=list)
    seen_from_m: dict[Name, Annotated[list[tuple[Coordinate, Coordinate]], Meta(max_length=10_000)]] = msgspec.field(
        default_factory=dict
    )
    dock: PoseRecord | None = None
    last_pose: PoseRecord | None = None
