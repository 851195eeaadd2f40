"""Groups of furniture: tables with chairs, small items on furniture, a kitchen's row along one wall."""

import math

from edgemap.geometry.se2 import SE2
from edgemap.simulation.apartment.furniture import Model
from edgemap.simulation.apartment.layout import SIDES, Layout, Placed
from edgemap.simulation.apartment.plan import RoomArea


def dining_group(home: Layout, room: RoomArea) -> None:
    """A table with two to six like chairs round it: pushed in, pulled out, askew."""
    for attempt in range(40):
        model = home.model("dining table")
        x = home.uniform(room.x0 + 0.7, room.x1 - 0.7)
        y = home.uniform(room.y0 + 0.7, room.y1 - 0.7)
        yaw = math.radians(90.0 * home.count(0, 3) + (home.uniform(-20, 20) if home.chance(0.15) else 0.0))
        # The tighter the room, the less must be free around the table; chairs that don't fit are left out.
        table = home.put("dining table", model, room, SE2(x, y, yaw), spare_m=(0.6 - 0.013 * attempt, 0.0))
        if table is not None:
            break
    else:
        return
    _chairs(home, table, room)
    small_items(home, table, room, home.count(0, 4), vases=0.45)


def _chairs(home: Layout, table: Placed, room: RoomArea) -> None:
    chair = home.model("chair")
    long, short = table.model.width_m, table.model.depth_m
    half = 1 if long < 1.25 else 2
    seats = [((i + 0.5) / half - 0.5, side) for side in (-1.0, 1.0) for i in range(half)]
    spots = [SE2(side * short / 2.0, along * long * 0.92, 0.0 if side < 0 else math.pi) for along, side in seats]
    spots += [SE2(0.0, side * long / 2.0, -side * math.pi / 2.0) for side in (-1.0, 1.0)]
    wanted, like = home.count(2, len(spots)), None
    for index in home.rng.permutation(len(spots))[:wanted]:
        tucked = home.uniform(0.02, 0.45) if home.chance(0.7) else -home.uniform(0.05, 0.35)
        reach = chair.depth_m * (tucked - 0.5)
        pose = table.pose_home_object @ spots[index] @ SE2(reach, home.uniform(-0.04, 0.04), home.uniform(-0.12, 0.12))
        if tucked < 0.0:
            pose = pose @ SE2(0.0, 0.0, home.uniform(-0.5, 0.5))
        # Chairs reach under the table they stand at, as far as their backs allow.
        like = home.put("chair", chair, room, pose, ignore=table, like=like) or like


def small_items(home: Layout, support: Placed, room: RoomArea, count: int, vases: float = 0.2) -> None:
    """Small items on a piece; vases: share of vases and small plants."""
    for _ in range(count):
        draw = home.rng.random()
        kind = "vase" if draw < vases * 0.6 else "small plant" if draw < vases else "table clutter"
        home.on_top(kind, support, room, spread=0.32)


def kitchen(home: Layout, room: RoomArea) -> None:
    """A row along one wall: cabinets, oven, sink and refrigerator side by side, cabinets on the wall above."""
    home.rng.permutation(4)  # an order of the walls that decides nothing any more, but what is drawn after it
    side = max(SIDES, key=lambda side: (_row_length(home, room, side), side))
    kinds = ["refrigerator", "lower cabinet", "oven", "sink cabinet", "lower cabinet", "lower cabinet"]
    _row(home, room, side, kinds if home.chance(0.5) else kinds[::-1])
    for kind in ("refrigerator", "oven"):
        if not any(item.kind == kind for item in home.placed):
            home.against_wall(kind, room)
    if room.x1 - room.x0 > 2.6 and home.chance(0.6):
        dining_group(home, room)
    home.some(room, home.against_wall, bin=0.5)
    for _ in range(home.count(0, 2)):
        home.by_wall("stool", room)
    home.some(room, home.in_corner, potted_plant=0.5)


def _row_length(home: Layout, room: RoomArea, side: str) -> float:
    """Length of a wall without its doorways."""
    low, high, face = room.wall(side)
    for door in home.plan.doorways:
        spans = (door.y0, door.y1) if side in {"near", "far"} else (door.x0, door.x1)
        if min(abs(face - spans[0]), abs(face - spans[1])) < 0.02:
            return (high - low) / 2.0
    return high - low


def _row(home: Layout, room: RoomArea, side: str, kinds: list[str]) -> None:
    low, high, _ = room.wall(side)
    at, cabinet, like, upper = low + 0.02, home.model("lower cabinet"), None, None
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
                    upper = _above(home, item, room, side, upper)
                break
            at += 0.15


def _above(home: Layout, item: Placed, room: RoomArea, side: str, upper: Model | None) -> Model:
    """What stands on a lower cabinet, and the cabinet above it: of the model that the row has already, if any."""
    low, high, _ = room.wall(side)
    middle = item.pose_home_object.x_m if side in {"near", "far"} else item.pose_home_object.y_m
    if home.chance(0.5):
        home.on_top("microwave" if home.chance(0.35) else "counter clutter", item, room, spread=0.1)
    upper = upper or home.model("upper cabinet")
    along = (middle - low - upper.width_m / 2.0 - 0.01) / max(high - low - upper.width_m - 0.02, 0.1)
    home.put("upper cabinet", upper, room, home.wall_pose(upper, room, side, along), upper.elevation_m, like=item)
    return upper
