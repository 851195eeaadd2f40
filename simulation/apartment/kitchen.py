"""Kitchens: a row of machines and cabinets along one wall."""

from edgemap.simulation.apartment.layout import SIDES, Layout
from edgemap.simulation.apartment.placed import Placed
from edgemap.simulation.apartment.plan import RoomArea
from edgemap.simulation.apartment.tables import dining_group


def kitchen(home: Layout, room: RoomArea) -> None:
    """A row along one wall: cabinets, oven, sink and refrigerator side by side, cabinets on the wall above."""
    sides = [SIDES[i] for i in home.rng.permutation(4)]
    rows = sorted((_row_length(home, room, side) for side in sides), reverse=True)
    side = rows[0][1]
    kinds = ["refrigerator", "lower cabinet", "oven", "sink cabinet", "lower cabinet", "lower cabinet"]
    _row(home, room, side, kinds if home.chance(0.5) else kinds[::-1])
    for kind in ("refrigerator", "oven"):
        if not any(item.kind == kind for item in home.placed):
            home.against_wall(kind, room)
    if room.x1 - room.x0 > 2.6 and home.chance(0.6):
        dining_group(home, room)
    if home.chance(0.5):
        home.against_wall("bin", room)
    for _ in range(home.count(0, 2)):
        home.by_wall("stool", room)
    if home.chance(0.5):
        home.in_corner("potted plant", room)


def _row_length(home: Layout, room: RoomArea, side: str) -> tuple[float, str]:
    """Length of a wall without its doorways."""
    low, high = (room.x0, room.x1) if side in {"near", "far"} else (room.y0, room.y1)
    face = {"near": room.y0, "far": room.y1, "left": room.x0, "right": room.x1}[side]
    for door in home.plan.doorways:
        spans = (door.y0, door.y1) if side in {"near", "far"} else (door.x0, door.x1)
        if min(abs(face - spans[0]), abs(face - spans[1])) < 0.02:
            return (high - low) / 2.0, side
    return high - low, side


def _row(home: Layout, room: RoomArea, side: str, kinds: list[str]) -> None:
    low, high = (room.x0, room.x1) if side in {"near", "far"} else (room.y0, room.y1)
    at, cabinet, like = low + 0.02, home.model("lower cabinet"), None
    for kind in kinds:
        model = cabinet if kind == "lower cabinet" else home.model(kind)
        while at + model.width_m < high:
            span = high - low - model.width_m - 0.02
            along = (at - low - 0.01) / span if span > 0 else 0.0
            front = like if "cabinet" in kind else None
            item = home.put(kind, model, room, home.wall_pose(model, room, side, along), like=front)
            if item is not None:
                at += model.width_m + 0.005
                if kind == "lower cabinet":
                    like = like or item
                    _above(home, item, room, side)
                break
            at += 0.15


def _above(home: Layout, item: Placed, room: RoomArea, side: str) -> None:
    low, high = (room.x0, room.x1) if side in {"near", "far"} else (room.y0, room.y1)
    middle = item.pose_home_object.x_m if side in {"near", "far"} else item.pose_home_object.y_m
    if home.chance(0.5):
        home.on_top("microwave" if home.chance(0.35) else "counter clutter", item, room, spread=0.1)
    upper = home.model("upper cabinet", usual=True)
    along = (middle - low - upper.width_m / 2.0 - 0.01) / max(high - low - upper.width_m - 0.02, 0.1)
    home.put("upper cabinet", upper, room, home.wall_pose(upper, room, side, along), upper.elevation_m, like=item)
