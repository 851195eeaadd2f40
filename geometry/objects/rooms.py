"""Which rooms a map has: the parts of its floor with ids, names, kinds and objects, the same ones from run to run."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import linear_sum_assignment

from edgemap.geometry.errors import MapError
from edgemap.geometry.grid.occupancy_grid import OccupancyGrid
from edgemap.geometry.grid.rooms import Disc, Door, Room, floor_parts, inside, passable
from edgemap.geometry.map_object import Ids, MapObject, id_order, radius_m
from edgemap.geometry.objects.annotations import Annotations

KINDS: Mapping[str, frozenset[str]] = {
    "kitchen": frozenset({"refrigerator", "oven", "sink", "microwave"}),
    "bedroom": frozenset({"bed"}),
    "living room": frozenset({"couch", "tv"}),
    "bathroom": frozenset({"toilet"}),
}
SAME_SHARE = 0.3  # of the floor that two outlines cover together, from which on they are one room
SAME_M = 0.5  # between the middles of one door in two runs, at most
BESIDE_M = 0.4  # from a door into the rooms on its sides


def rooms_of(
    objects: Sequence[MapObject], annotations: Annotations, grid: OccupancyGrid | None
) -> tuple[tuple[Room, ...], tuple[Door, ...]]:
    """Rooms and doors of a map, by id. Those that the annotations know keep their ids and names where the floor is the
    same; named ones stay in any case, and an earlier door stays between its rooms when it is closed. Without a grid
    they are the earlier ones."""
    if grid is None:
        rooms, doors = annotations.rooms, annotations.doors
    else:
        parts, openings = parts_of(objects, grid)
        rooms, became = _known_rooms(parts, annotations.rooms)
        doors = [replace(door, rooms=(became[door.rooms[0]], became[door.rooms[1]])) for door in openings]
        doors = _known_doors(doors, annotations.doors, rooms, grid)
    return tuple(_furnished(room, objects) for room in sorted(rooms, key=_order)), tuple(sorted(doors, key=_order))


def parts_of(
    objects: Sequence[MapObject], grid: OccupancyGrid, fine: bool = False
) -> tuple[tuple[Room, ...], tuple[Door, ...]]:
    """As `floor_parts`, around the objects."""
    discs = tuple(Disc(*(round(value, 2) for value in (*item.place_m, radius_m(item)))) for item in objects)
    return floor_parts(grid, discs, fine)


def room_at(rooms: Iterable[Room], point_m: ArrayLike) -> Room | None:
    """The room around a point of the map; None where there is none."""
    return next((room for room in rooms if inside(room.corners_m, np.asarray(point_m))), None)


def room_called(rooms: Sequence[Room], text: str) -> Room | None:
    """The room that a text means: by id, else by name, else by kind. Raises MapError where it means several."""
    wanted = text.strip().casefold()
    for word in ("id", "name", "kind"):
        found = [room for room in rooms if getattr(room, word).casefold() == wanted != ""]
        if len(found) > 1:
            raise MapError(f"{text!r} is {len(found)} rooms: {', '.join(room.id for room in found)}")
        if found:
            return found[0]
    return None


def title_of(room: Room) -> str:
    """What a person calls a room."""
    return room.name or room.kind or room.id


def _furnished(room: Room, objects: Sequence[MapObject]) -> Room:
    """The room with its objects, and with the kind that most of them indicate."""
    within = [item for item in objects if inside(room.corners_m, item.position_m)]
    labels = [item.labels or {item.label: 1.0} for item in within]
    votes = {kind: sum(one.get(label, 0.0) for one in labels for label in typical) for kind, typical in KINDS.items()}
    kind = max(votes, key=lambda kind: votes[kind])
    return replace(room, kind=kind if votes[kind] >= 0.5 else "", objects=tuple(item.id for item in within))


def _known_rooms(parts: Sequence[Room], known: Sequence[Room]) -> tuple[list[Room], dict[str, str]]:
    """The parts with ids and names, and their ids by their numbers."""
    both_m2 = np.array([[shared_m2(room, part) for part in parts] for room in known]).reshape(len(known), len(parts))
    areas_m2 = [np.array([room.area_m2 for room in some]) for some in (known, parts)]
    same = both_m2 / (areas_m2[0][:, None] + areas_m2[1] - both_m2)
    rows, columns = linear_sum_assignment(same, maximize=True)
    pairs = {int(b): known[a] for a, b in zip(rows, columns, strict=True) if same[a, b] >= SAME_SHARE}
    ids = Ids(room.id for room in known)
    rooms = [
        replace(part, id=pairs[n].id, name=pairs[n].name) if n in pairs else replace(part, id=ids.new("room"))
        for n, part in enumerate(parts)
    ]
    became = {part.id: room.id for part, room in zip(parts, rooms, strict=True)}
    for row in [row for row, room in enumerate(known) if room.name and room not in pairs.values()]:
        most = int(both_m2[row].argmax()) if parts else 0
        if parts and both_m2[row, most] > areas_m2[0][row] / 2.0 and not rooms[most].name:
            rooms[most] = replace(rooms[most], name=known[row].name)  # it has become part of that one
        else:
            rooms.append(known[row])
    return rooms, became


def shared_m2(a: Room, b: Room) -> float:
    """Area of the floor that two outlines both cover, by points."""
    low, high = np.min(a.corners_m, axis=0), np.max(a.corners_m, axis=0)
    points = low + (high - low) * (np.stack(np.meshgrid(*[np.arange(40)] * 2), axis=-1) + 0.5) / 40
    return float((inside(a.corners_m, points) & inside(b.corners_m, points)).mean() * np.prod(high - low))


def _known_doors(
    found: Sequence[Door], known: Sequence[Door], rooms: Sequence[Room], grid: OccupancyGrid
) -> list[Door]:
    doors, left, ids = list[Door](), list(known), Ids(door.id for door in known)
    for door in found:
        near = min(left, key=lambda one: _apart_m(one, door), default=None)
        if near is not None and _apart_m(near, door) <= SAME_M:
            left.remove(near)
            doors.append(replace(door, id=near.id))
        else:
            doors.append(replace(door, id=ids.new("door")))
    for door in left:
        along = np.subtract(door.to_m, door.from_m)
        aside = BESIDE_M * np.array([-along[1], along[0]]) / max(float(np.hypot(*along)), 1e-9)
        a, b = (room_at(rooms, door.centre_m + side) for side in (aside, -aside))
        if a is not None and b is not None and a.id != b.id:
            doors.append(replace(door, rooms=(a.id, b.id), open=passable(grid, door.from_m, door.to_m)))
    return doors


def _apart_m(a: Door, b: Door) -> float:
    return float(np.hypot(*(a.centre_m - b.centre_m)))


def _order(item: Room | Door) -> tuple[str, int]:
    return id_order(item.id)
