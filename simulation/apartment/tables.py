"""Tables with chairs around them, and things on furniture."""

import math

from edgemap.geometry.se2 import SE2
from edgemap.simulation.apartment.layout import Layout
from edgemap.simulation.apartment.placed import Placed
from edgemap.simulation.apartment.plan import RoomArea


def dining_group(home: Layout, room: RoomArea) -> None:
    """A table with two to six like chairs round it: pushed in, pulled out, askew."""
    table = None
    for attempt in range(40):
        model = home.model("dining table")
        x = home.uniform(room.x0 + 0.7, room.x1 - 0.7)
        y = home.uniform(room.y0 + 0.7, room.y1 - 0.7)
        yaw = math.radians(90.0 * home.count(0, 3) + (home.uniform(-20, 20) if home.chance(0.15) else 0.0))
        # The tighter the room, the less must be free around the table; chairs that don't fit are left out.
        table = home.put("dining table", model, room, SE2(x, y, yaw), spare_m=(0.6 - 0.013 * attempt, 0.0))
        if table is not None:
            break
    if table is None:
        return
    _chairs(home, table, room)
    things(home, table, room, home.count(0, 4), vases=0.45)


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
        like = home.put("chair", chair, room, pose, ignore=(table,), like=like) or like


def things(home: Layout, support: Placed, room: RoomArea, count: int, vases: float = 0.2) -> None:
    """Small things on a piece; vases: share of vases and small plants."""
    for _ in range(count):
        draw = home.rng.random()
        kind = "vase" if draw < vases * 0.6 else "small plant" if draw < vases else "table clutter"
        home.on_top(kind, support, room, spread=0.32)
