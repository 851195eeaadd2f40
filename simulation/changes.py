"""`moved.json`: what differs between a home and the same one with furniture moved, and where the new drive starts."""

from __future__ import annotations

import math
from typing import Any

from edgemap.geometry.se2 import SE2
from edgemap.simulation.apartment.placed import Placed
from edgemap.simulation.world import World


def moved_record(world: World) -> dict[str, Any]:
    """Pieces removed and moved, with ids as in objects.json, and the new drive's `start` (x m, y m, yaw degrees): all
    in the start-pose frame of the seed's own drive, which is what its map is in. Empty where nothing was moved."""
    if world.changes is None or world.start_before is None:
        return {}
    pose_before_home = world.start_before.inverse()
    start = pose_before_home @ world.poses()[0]
    return {
        "frame": "start pose of the drive before",
        "start": [round(start.x_m, 4), round(start.y_m, 4), round(math.degrees(start.yaw_rad), 4)],
        "removed": [_named(item) | {"was_m": _place(item, pose_before_home)} for item in world.changes.removed],
        "moved": [
            _named(old) | {"was_m": _place(old, pose_before_home), "is_m": _place(new, pose_before_home)}
            for old, new in world.changes.moved
        ],
    }


def _named(item: Placed) -> dict[str, Any]:
    return {"id": item.id, "label": item.label}


def _place(item: Placed, pose_before_home: SE2) -> list[float]:
    x_m, y_m = pose_before_home.apply([item.pose_home_object.x_m, item.pose_home_object.y_m])
    return [round(float(x_m), 4), round(float(y_m), 4)]
