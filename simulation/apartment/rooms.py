"""Furnishing: one short recipe per kind of room, large pieces first."""

import math
from collections.abc import Callable

from edgemap.geometry.se2 import SE2
from edgemap.simulation.apartment.groups import dining_group, kitchen, small_items
from edgemap.simulation.apartment.layout import SIDES, Layout, Placed
from edgemap.simulation.apartment.plan import RoomArea

_OPPOSITE = {"near": "far", "far": "near", "left": "right", "right": "left"}


def furnish_room(home: Layout, room: RoomArea, lone: bool, clutter: float) -> None:
    """Furnishes one room. lone: whether it is the only room. clutter: 0 for tidy to 1."""
    _RECIPES[room.kind](home, room)
    if lone:
        dining_group(home, room)
    _extras(home, room, clutter)


def _living(home: Layout, room: RoomArea) -> None:
    _seating(home, room)
    if room.x1 - room.x0 > 4.2 and home.chance(0.6):
        dining_group(home, room)
    home.some(room, home.against_wall, bookcase=0.7, drawers=0.4, radiator=0.5)
    for _ in range(home.count(1, 3)):
        home.in_corner("potted plant", room) if home.chance(0.6) else home.by_wall("potted plant", room)


def _seating(home: Layout, room: RoomArea) -> None:
    """Sofa on one wall, television across the room, armchairs beside the sofa or facing it."""
    sides = [SIDES[i] for i in home.rng.permutation(4)]
    for side in sides:
        sofa = home.against_wall("couch" if home.chance(0.85) else "corner couch", room, [side])
        if sofa is not None:
            break
    else:
        return
    _television(home, room, _OPPOSITE[side])
    if home.chance(0.6):
        table = home.before("coffee table", sofa, room, home.uniform(0.32, 0.45))
        if table is not None:
            small_items(home, table, room, home.count(0, 2))
    if home.chance(0.75):
        home.beside("armchair", sofa, room, home.uniform(0.05, 0.25))
    for _ in range(home.count(0, 1)):
        _facing(home, "armchair", sofa, room)
    if home.chance(0.5):
        home.beside("floor lamp", sofa, room, 0.08)


def _facing(home: Layout, kind: str, anchor: Placed, room: RoomArea) -> None:
    """Somewhere before a piece, turned half towards it."""
    for _ in range(12):
        across, away = home.uniform(-1.6, 1.6), home.uniform(1.3, 2.2)
        turn = math.atan2(-across, -away) + home.uniform(-0.3, 0.3)
        pose = anchor.pose_home_object @ SE2(away, across, turn)
        if home.put(kind, home.model(kind), room, pose):
            return


def _television(home: Layout, room: RoomArea, side: str) -> None:
    if home.chance(0.75):
        stand = home.against_wall("tv stand", room, [side], above_m=0.8)
        stand = stand or home.against_wall("tv stand", room, above_m=0.8)
        if stand is not None:
            home.on_top("tv", stand, room, spread=0.1, back=True)
            if home.chance(0.4):
                home.on_top("vase", stand, room, spread=0.45)
            return
    home.against_wall("tv", room, [side], z_m=home.uniform(0.75, 1.15))


def _dining(home: Layout, room: RoomArea) -> None:
    dining_group(home, room)
    if home.chance(0.7):
        drawers = home.against_wall("drawers", room)
        if drawers is not None:
            small_items(home, drawers, room, home.count(1, 3), vases=0.6)
    home.some(room, home.against_wall, bookcase=0.4)
    for _ in range(home.count(1, 2)):
        home.in_corner("potted plant", room)
    home.some(room, home.in_corner, armchair=0.4)


def _bedroom(home: Layout, room: RoomArea) -> None:
    """Head of the bed at a wall, bedside tables, wardrobe, and what else fits."""
    bed = home.against_wall("bed", room)
    if bed is not None:
        for _ in range(home.count(1, 2)):
            table = home.beside("bedside table", bed, room, 0.05)
            if table is not None:
                home.on_top("table lamp" if home.chance(0.6) else "table clutter", table, room, spread=0.1)
    home.against_wall("wardrobe", room)
    if home.chance(0.45):
        _workplace(home, room)
    if home.chance(0.4):
        drawers = home.against_wall("drawers", room)
        if drawers is not None:
            home.on_top("tv", drawers, room, 0.1, back=True) if home.chance(0.5) else small_items(
                home, drawers, room, 2
            )
    home.some(room, home.in_corner, armchair=0.4)
    home.by_wall("potted plant", room)
    home.some(room, home.by_wall, suitcase=0.6, backpack=0.6)


def _study(home: Layout, room: RoomArea) -> None:
    _workplace(home, room)
    home.some(room, home.against_wall, bookcase=0.9)
    home.some(room, home.against_wall, bookcase=0.5, drawers=0.3, radiator=0.5)
    if home.chance(0.5):
        home.in_corner("armchair", room)
    elif home.chance(0.6):
        home.against_wall("couch", room)
    home.some(room, home.by_wall, backpack=0.5)
    for _ in range(home.count(1, 2)):
        home.in_corner("potted plant", room)


def _workplace(home: Layout, room: RoomArea) -> None:
    desk = home.against_wall("desk", room)
    if desk is None:
        return
    home.before("office chair" if home.chance(0.7) else "chair", desk, room, -home.uniform(-0.1, 0.2), under=True)
    if home.chance(0.8):
        home.on_top("laptop" if home.chance(0.5) else "computer", desk, room, spread=0.15, back=True)
    home.on_top("desk lamp", desk, room, spread=0.4)
    small_items(home, desk, room, home.count(0, 2))


def _bathroom(home: Layout, room: RoomArea) -> None:
    home.some(room, home.against_wall, bath=0.7)
    home.against_wall("toilet", room)
    kind = "basin" if home.chance(0.75) else "vanity"
    for _ in range(12):
        model = home.model(kind)
        side, along = SIDES[home.count(0, 3)], home.uniform(0.0, 1.0)
        if home.put(kind, model, room, home.wall_pose(model, room, side, along), model.elevation_m):
            break
    home.some(room, home.against_wall, washing_machine=0.6, bin=0.6, radiator=0.4)
    home.some(room, home.in_corner, potted_plant=0.5)


def _hall(home: Layout, room: RoomArea) -> None:
    home.some(room, home.against_wall, wardrobe=0.6, drawers=0.6, chair=0.7, bookcase=0.3)
    home.some(room, home.by_wall, suitcase=0.8, backpack=0.7, potted_plant=0.8, vase=0.4)


def _extras(home: Layout, room: RoomArea, clutter: float) -> None:
    """What stands about in any room."""
    home.some(room, home.by_wall, vase=0.35)
    more = 0.4 + clutter
    home.some(room, home.by_wall, suitcase=0.2 * more, backpack=0.2 * more, floor_clutter=0.6 * more, bin=0.2 * more)
    home.some(room, home.anywhere, cat=0.12, dog=0.10)


_RECIPES: dict[str, Callable[[Layout, RoomArea], None]] = {
    "living": _living,
    "dining": _dining,
    "kitchen": kitchen,
    "bedroom": _bedroom,
    "study": _study,
    "bathroom": _bathroom,
    "hall": _hall,
}
