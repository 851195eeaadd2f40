"""`map.json`: the map on disk, written atomically and read with every value checked."""

import hashlib
import json
import math
import uuid
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
from pathlib import Path

import msgspec
import numpy as np

from edgemap.geometry.errors import MapError
from edgemap.geometry.grid.occupancy_grid import OccupancyGrid
from edgemap.geometry.grid.rooms import Door, Room
from edgemap.geometry.grid.walls import walls_of
from edgemap.geometry.map_object import MapEvent, MapObject, ObjectFootprint, outline_m
from edgemap.geometry.objects.annotations import NO_ANNOTATIONS, Annotations, MapIdentity, Zone
from edgemap.geometry.objects.approach import Approach
from edgemap.geometry.objects.rooms import rooms_of
from edgemap.geometry.observations.class_extents import footprint_m
from edgemap.geometry.se2 import SE2
from edgemap.runtime.frames.disk import write_atomically
from edgemap.runtime.frames.reading import decode_json, read_bytes
from edgemap.runtime.step.grid_file import grid_before, grid_name, grid_sum, save_grid
from edgemap.runtime.step.map_records import (
    MAXIMUM_OBJECTS,
    HeadRecord,
    MapObjectRecord,
    MapRecord,
    seconds,
)
from edgemap.runtime.step.wall_clock import host_clock, utc_text

FORMAT = "edgemap.map/1"
ROUNDING_M2 = 1e-9  # of the file's covariances
DEFAULT_MAP_ID = "map"


def map_document(
    objects: list[MapObject],
    annotations: Annotations = NO_ANNOTATIONS,
    grid: OccupancyGrid | None = None,
    grid_file: str = "grid.npz",
    last_pose: SE2 | None = None,
) -> dict:
    """The map as the JSON document that `map.json` holds. grid_file: name of the grid's file.

    Where there are any: `map_id`, `generation` and `verdict`; `seen_from_m`, id to the positions from which it was
    observed; `zones`; `deleted`, objects that a person has deleted; `vanished`, objects that are gone; `grid`, `walls`,
    `rooms` and `doors`; `dock`; `last_pose`, of the robot when the map was saved. Of an object `name`, `confirmed`,
    `corrected` and `depth_m`, stated by a person; `yaw_rad` is null where its `footprint` is a circle.
    """
    views = {item.id: [_place(view, 3) for view in item.seen_from_m] for item in objects if item.seen_from_m}
    document: dict = {"format": FORMAT, "frame": "map"} | identity_record(annotations.identity)
    document |= {"objects": [object_record(item) for item in objects]} | _present(seen_from_m=views)
    if grid is not None:
        document |= {"grid": grid_file, "grid_sum": grid_sum(grid), "walls": wall_records(grid)}
    rooms, doors = rooms_of(objects, annotations, grid)
    return document | _present(
        rooms=[room_record(room) for room in rooms],
        doors=[door_record(door) for door in doors],
        zones=[zone_record(zone) for zone in annotations.zones],
        deleted=[object_record(item) for item in annotations.deleted],
        vanished=[object_record(item) for item in annotations.vanished],
        dock=annotations.dock and pose_record(annotations.dock),
        last_pose=last_pose and pose_record(last_pose),
    )


def _present(**values: object) -> dict[str, object]:
    """The values that there are: neither None nor empty."""
    return {name: value for name, value in values.items() if value is not None and value not in ("", [], {})}


def identity_record(identity: MapIdentity | None) -> dict:
    """Which map it is, and how far it can be trusted, as `map.json` holds it."""
    if identity is None:
        return {}
    verdict = {"level": identity.level, "reasons": list(identity.reasons)} if identity.level else None
    return {"map_id": identity.map_id, "generation": identity.generation} | _present(verdict=verdict)


def event_record(event: MapEvent) -> dict:
    """One entry of a history as `map.json` holds it."""
    from_m, to_m = (place_m and _place(place_m) for place_m in (event.from_m, event.to_m))
    record = {"at": utc_text(event.at), "what": event.what, "by": event.by}
    return record | _present(from_m=from_m, to_m=to_m, other=event.other)


def change_record(item: MapObject, event: MapEvent) -> dict:
    """An entry of a history with its object, as HTTP and `map show --history` give it."""
    return {"id": item.id, "label": item.label} | _present(name=item.name) | event_record(event)


def pose_record(pose: SE2) -> dict[str, float]:
    """A pose of the base in the map frame as `map.json` holds it."""
    return {"x_m": round(pose.x_m, 4), "y_m": round(pose.y_m, 4), "yaw_rad": round(pose.yaw_rad, 5)}


def goal_record(goal: Approach) -> dict:
    """A pose from which a robot faces an object, as the command line, HTTP and agents get it."""
    return pose_record(goal.pose) | {"standoff_m": round(goal.standoff_m, 3), "floor": goal.floor}


def object_record(item: MapObject) -> dict:
    """One object of the map as `map.json` holds it."""
    depth_m = None if item.depth_m is None else round(item.depth_m, 4)
    stated = _present(name=item.name, confirmed=item.confirmed or None, corrected=list(item.corrected), depth_m=depth_m)
    shape, symmetric = item.footprint, (item.covariance_m2 + item.covariance_m2.T) / 2.0
    return stated | {
        "yaw_rad": None if shape.yaw_rad is None else round(shape.yaw_rad, 5),
        "yaw_sigma_rad": round(shape.yaw_sigma_rad, 5) if math.isfinite(shape.yaw_sigma_rad) else None,
        "footprint": [_place(corner) for corner in outline_m(item).tolist()],
        "id": item.id,
        "label": item.label,
        "x_m": round(float(item.position_m[0]), 6),
        "y_m": round(float(item.position_m[1]), 6),
        "covariance_m2": [[round(float(v), 9) for v in row] for row in symmetric],
        "width_m": round(item.width_m, 4),
        "height_m": round(item.height_m, 4),
        "count": item.count,
        "confidence": round(item.confidence, 6),
        "first_seen_s": round(item.first_seen_s, 6),
        "last_seen_s": round(item.last_seen_s, 6),
        "labels": {label: round(share, 6) for label, share in item.labels.items()},
        "first_seen": utc_text(item.first_seen),
        "last_seen": utc_text(item.last_seen),
        "since": utc_text(item.since),
        "earlier": item.earlier,
        "history": [event_record(event) for event in item.history],
    }


def wall_records(grid: OccupancyGrid) -> list[dict]:
    """The walls of a grid as `map.json` holds them."""
    return [{"from_m": _place(wall.from_m, 3), "to_m": _place(wall.to_m, 3)} for wall in walls_of(grid)]


def zone_record(zone: Zone | Room) -> dict:
    """One zone as `map.json` holds it."""
    return {"id": zone.id, "name": zone.name, "corners_m": [_place(corner) for corner in zone.corners_m]}


def room_record(room: Room) -> dict:
    """One room as `map.json` holds it."""
    return zone_record(room) | {"kind": room.kind, "area_m2": round(room.area_m2, 2), "objects": list(room.objects)}


def door_record(door: Door) -> dict:
    """One door as `map.json` holds it."""
    ends = {"from_m": _place(door.from_m, 3), "to_m": _place(door.to_m, 3)}
    return {"id": door.id} | ends | {"rooms": list(door.rooms), "open": round(door.open, 3)}


def _place(point_m: Sequence[float], digits: int = 4) -> list[float]:
    """A position as JSON holds it."""
    return [round(float(value), digits) for value in point_m]


def saved_text(document: dict) -> str:
    """A map's document as the text of `map.json`, with the time of now; null where the host's clock is not set."""
    saved_at = {"saved_at": utc_text(host_clock().utc_s)} if "map_id" in document else {}
    return json.dumps(document | saved_at, indent=1) + "\n"


def save_map(
    path: Path,
    objects: list[MapObject],
    annotations: Annotations = NO_ANNOTATIONS,
    grid: OccupancyGrid | None = None,
    grid_saved: bool = False,
) -> None:
    """Write `map.json` and the grid, each atomically. grid_saved: the grid's file is up to date."""
    if grid is not None and not grid_saved:
        save_grid(path.with_name(grid_name(path)), grid)
    replace_map(path, saved_text(map_document(objects, annotations, grid, grid_name(path))))


def replace_map(path: Path, text: str, keeps_before: bool = False) -> None:
    """Write a map's text atomically, once it reads back: a map that no reader takes never replaces one that they do.

    keeps_before: the file that it replaces stays as `NAME.before.json`. Raises MapError or DiskError.
    """
    read_map(text.encode(), f"{path}, not saved")
    if keeps_before and path.is_file():
        write_atomically(path.with_suffix(".before.json"), path.read_text())
    write_atomically(path, text)
    with suppress(OSError):
        grid_before(path.with_name(grid_name(path))).unlink(missing_ok=True)


def load_map(path: Path) -> list[MapObject]:
    """The objects of a map.json, or of the one of a run folder. Raises as `load_annotated_map`."""
    return load_annotated_map(path)[0]


def load_annotated_map(path: Path) -> tuple[list[MapObject], Annotations]:
    """Read a map.json, or the one of a run folder: objects, and what people have added; unknown fields are left out.

    Raises MapError in one line for anything that is not a map: numbers out of range, covariances that are not symmetric
    and positive, repeated ids.
    """
    path = map_path(path)
    before = path.with_suffix(".before.json")
    try:
        return read_map(read_bytes(path, MapError), str(path))
    except MapError as error:
        hint = f"; {before} is that of the run before" if before.is_file() else ""
        raise MapError(f"{error}{hint}") from None


def map_path(path: Path) -> Path:
    """The map.json that a MAP means: itself, or the one of a folder."""
    return path / "map.json" if path.is_dir() else path


def read_map(data: bytes, source: str, most: int = MAXIMUM_OBJECTS) -> tuple[list[MapObject], Annotations]:
    """Parses the text of a map.json as `load_annotated_map` does. source: for messages. most: greatest number of
    objects, counted before any is made."""
    if data.count(b'"covariance_m2"') > most:  # one in every object
        raise MapError(f"{source}: more than {most} objects")
    other = f"{source}: not an {FORMAT} document"
    if decode_json(data, HeadRecord, other, MapError).format != FORMAT:
        raise MapError(other)
    where = f"{source}: damaged map"
    document = decode_json(data, MapRecord, where, MapError)
    if len(document.objects) + len(document.deleted) > most:  # a name may be written in another way
        raise MapError(f"{source}: more than {most} objects")
    for what, records in (
        ("objects", (*document.objects, *document.deleted)), ("vanished objects", document.vanished),
        ("zones", document.zones), ("rooms", document.rooms), ("doors", document.doors),
    ):  # fmt: skip
        seen: set[str] = set()  # each is a namespace
        for record in records:
            if record.id in seen:
                raise MapError(f"{where}: two {what} have the id {record.id!r}")
            seen.add(record.id)
    objects, deleted, vanished = (
        [_object_of(record, document.seen_from_m.get(record.id, []), where) for record in records]
        for records in (document.objects, document.deleted, document.vanished)
    )
    plain = partial(msgspec.convert, from_attributes=True)
    zones, rooms = plain(document.zones, tuple[Zone, ...]), plain(document.rooms, tuple[Room, ...])
    doors = plain(document.doors, tuple[Door, ...])
    dock, last = (record and record.pose for record in (document.dock, document.last_pose))
    return objects, Annotations(
        zones, tuple(deleted), dock, rooms, doors, tuple(vanished), _identity_of(document, data), last
    )


def _identity_of(document: MapRecord, data: bytes) -> MapIdentity:
    """Which map a file holds. One that an older edgemap has written gets an id of its content."""
    map_id = document.map_id or str(uuid.uuid5(uuid.NAMESPACE_URL, f"{FORMAT}:{hashlib.sha256(data).hexdigest()}"))
    identity = MapIdentity(map_id, document.generation, seconds(document.saved_at))
    if document.verdict is None:
        return identity
    return replace(identity, level=document.verdict.level, reasons=tuple(document.verdict.reasons))


def _object_of(record: MapObjectRecord, views: list[tuple[float, float]], where: str) -> MapObject:
    covariance = np.array(record.covariance_m2)
    (xx, xy), (yx, yy) = covariance.tolist()
    if abs(xy - yx) > ROUNDING_M2 or min(xx, yy, *np.linalg.eigvalsh(covariance)) < -ROUNDING_M2:
        raise MapError(f"{where}: object {record.id!r}: covariance {covariance.tolist()} m2 is no covariance")
    if record.last_seen_s < record.first_seen_s:
        raise MapError(
            f"{where}: object {record.id!r}: last seen at {record.last_seen_s} s, first at {record.first_seen_s} s"
        )
    covariance[0, 1] = covariance[1, 0] = (xy + yx) / 2.0
    covariance += np.eye(2) * max(0.0, 2.0 * ROUNDING_M2 - float(np.linalg.eigvalsh(covariance)[0]))
    by_person = record.yaw_rad if "yaw" in record.corrected else None
    return MapObject(
        record.id, record.label, np.array([record.x_m, record.y_m]), covariance, record.width_m, record.height_m,
        record.count, record.confidence, record.first_seen_s, record.last_seen_s, tuple(views),
        record.labels, record.name, record.confirmed, tuple(record.corrected), by_person, record.depth_m,
        seconds(record.first_seen), seconds(record.last_seen), seconds(record.since),
        tuple(one.event for one in record.history), record.earlier, measured=_measured(record),
    )  # fmt: skip


def _measured(record: MapObjectRecord) -> ObjectFootprint | None:
    """The measured footprint of an object; None of older maps."""
    corners = np.array(record.footprint)
    if len(corners) < 4:
        return None
    if record.yaw_rad is not None and record.yaw_sigma_rad is not None:
        depth_m, width_m = np.linalg.norm(corners[[0, 1]] - corners[[3, 0]], axis=1).tolist()
        return ObjectFootprint(width_m, depth_m, record.yaw_rad, record.yaw_sigma_rad)
    side_m = math.sqrt(math.pi) * float(np.linalg.norm(corners - corners.mean(axis=0), axis=1).mean())
    usual_m = math.sqrt(math.prod(footprint_m(record.label, record.width_m)))
    is_usual = abs(side_m - usual_m) < 1e-3  # but for the file's rounding
    return None if record.yaw_rad is not None or is_usual else ObjectFootprint(side_m, side_m)


def object_uuid(object_id: str, map_id: str = DEFAULT_MAP_ID) -> str:
    """Name-based UUID (RFC 9562, version 5) of an object of a map, as text.

    It depends on both ids only: a map that grows keeps the UUIDs of its objects, on every machine.
    """
    return str(uuid.uuid5(uuid.uuid5(uuid.NAMESPACE_URL, f"{FORMAT}:{map_id}"), object_id))
