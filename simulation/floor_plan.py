"""The floor plan of a home as truth beside a drive: walls, rooms, doorways and furniture."""

import json
from typing import Any

import numpy as np

from edgemap.geometry.se2 import SE2
from edgemap.runtime.inputs.drives.floor_plan import FORMAT, PLAN_NAME
from edgemap.simulation.apartment.apartment import Apartment
from edgemap.simulation.apartment.plan import Rectangle
from edgemap.simulation.apartment.space import rectangle_corners
from edgemap.simulation.render.mesh import Array
from edgemap.simulation.store import FrameStore, write_text
from edgemap.simulation.world import World


def floor_plan_record(apartment: Apartment, pose_home_map: SE2) -> dict[str, Any]:
    """Contents of `floor_plan.json`, in the map frame, metres. Furniture is its oriented bounding rectangle with its
    lowest and highest point; walls contain open door leaves.
    """
    pose_map_home, plan = pose_home_map.inverse(), apartment.plan

    def corners(points: Array) -> list[list[float]]:
        return np.round(pose_map_home.apply(points), 4).tolist()

    def rectangle(area: Rectangle) -> list[list[float]]:
        return corners(rectangle_corners(area))

    return {
        "format": FORMAT,
        "frame": "map",
        "walls": [{"corners_m": rectangle(wall)} for wall in plan.walls],
        "rooms": [{"kind": room.kind, "corners_m": rectangle(room.rectangle)} for room in plan.rooms],
        "doorways": [{"corners_m": rectangle(door.rectangle)} for door in plan.doorways],
        "footprints": [
            {
                "id": item.id,
                "label": item.label,
                "low_m": round(float(item.z_m), 4),
                "high_m": round(float(item.z_m + item.model.height_m), 4),
                "corners_m": corners(item.footprint_home_m()),
            }
            for item in apartment.furniture
        ],
    }


def write_floor_plan(world: World, store: FrameStore) -> None:
    """Write it beside the other truth files. Raises SimulationError."""
    record = floor_plan_record(world.apartment, world.poses()[0])
    write_text(store.folder / PLAN_NAME, json.dumps(record, indent=None) + "\n")
