"""`floor_plan.json`, a drive's optional truth about the floor: walls, rooms and footprints, checked."""

from pathlib import Path
from typing import Annotated

import msgspec
from msgspec import Meta

from edgemap.runtime.frames.errors import CameraError
from edgemap.runtime.frames.reading import Coordinate, decode_json, read_bytes

PLAN_NAME, FORMAT = "floor_plan.json", "edgemap.floor_plan/1"
PLAN_BYTES = 8 << 20
Corners = Annotated[list[tuple[Coordinate, Coordinate]], Meta(min_length=3, max_length=1000)]


class Area(msgspec.Struct):
    """A polygon of the floor, start-pose frame, metres. kind: of a room."""

    corners_m: Corners
    kind: Annotated[str, Meta(max_length=200)] = ""


class Footprint(msgspec.Struct):
    """The footprint of an object on or above the floor, from low_m to high_m above it."""

    corners_m: Corners
    low_m: Coordinate = 0.0
    high_m: Coordinate = 1.0
    label: Annotated[str, Meta(max_length=200)] = ""


class FloorPlan(msgspec.Struct):
    """True floor plan of a home. Walls are solid; rooms and doorways are floor outside of walls and footprints."""

    format: str
    walls: Annotated[list[Area], Meta(max_length=10_000)]
    rooms: Annotated[list[Area], Meta(max_length=10_000)]
    doorways: Annotated[list[Area], Meta(max_length=10_000)] = []
    footprints: Annotated[list[Footprint], Meta(max_length=10_000)] = []


def read_floor_plan(folder: Path) -> FloorPlan | None:
    """The floor plan in a drive's folder; None where there is none. Raises CameraError."""
    path = folder / PLAN_NAME
    if not path.is_file():
        return None
    plan = decode_json(read_bytes(path, PLAN_BYTES, CameraError), FloorPlan, path, CameraError)
    if plan.format != FORMAT:
        raise CameraError(f"{path}: not an {FORMAT} document")
    return plan
