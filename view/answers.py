"""State of a run as plain JSON values, the same for the page's socket and for the API."""

import math
import time
from collections.abc import Sequence
from typing import Any

import msgspec
import numpy as np

from edgemap.geometry.grid.occupancy_grid import OccupancyGrid
from edgemap.geometry.map_object import MapObject, radius_m
from edgemap.geometry.objects.annotations import Annotations, Zone
from edgemap.geometry.objects.queries import changes, inside_polygon
from edgemap.geometry.objects.rooms import rooms_of
from edgemap.geometry.objects.zone_watch import ZoneEvent
from edgemap.runtime.frames.faults import Fault
from edgemap.runtime.outputs.verdict.causes import CAUSE_OF
from edgemap.runtime.outputs.verdict.verdict import is_doubtful
from edgemap.runtime.step.map_file import (
    change_record,
    door_record,
    object_record,
    room_record,
    wall_records,
    zone_record,
)
from edgemap.runtime.step.slam import StepResult
from edgemap.view.page import LivePage, PageSnapshot
from edgemap.view.status import pose_sigma, status

plain = msgspec.json.Encoder(enc_hook=float).encode  # JSON bytes; numpy's numbers are taken


def health_answer(page: LivePage, usage: dict[str, float | None]) -> dict[str, Any]:
    """Status, camera, speed and load."""
    snapshot = page.newest
    return {
        "state": page.state,
        "camera_state": page.camera_state(),
        "status": status(page),
        "rate_hz": page.rate_hz(),
        "step_ms": round(float(sum(snapshot.result.stages_ms.values())), 3) if snapshot else None,
        "age_s": round(time.monotonic() - snapshot.arrived_s, 3) if snapshot else None,
        "vitals": usage,
        "fault_count": page.faults.total,
    }


def pose_answer(result: StepResult) -> dict[str, Any]:
    """The robot's base in the map frame, with its covariance over (x, y, yaw)."""
    pose, (sigma_m, sigma_rad) = result.pose_map_base, pose_sigma(result)
    return {
        "frame": result.frame.index,
        "stamp_s": result.frame.stamp_s,
        "x_m": pose.x_m,
        "y_m": pose.y_m,
        "yaw_rad": pose.yaw_rad,
        "sigma_m": sigma_m,
        "sigma_yaw_rad": sigma_rad,
        "covariance": result.pose_covariance.tolist(),
        "travelled_m": result.travelled_m,
    }


def frame_answer(result: StepResult) -> dict[str, Any]:
    """The detections of the newest picture, and its stage times."""
    return {
        "frame": result.frame.index,
        "stamp_s": result.frame.stamp_s,
        "boxes": boxes(result),
        "stages_ms": result.stages_ms,
        "motion_fault": "; ".join(map(str, result.motion.faults)),
    }


def map_object_answer(item: MapObject) -> dict[str, Any]:
    """One object as in map.json, with its footprint (width, depth) and the radius of a circle that takes as much."""
    shape = item.footprint
    return object_record(item) | {
        "doubtful": is_doubtful(item),
        "radius_m": round(radius_m(item), 3),
        "footprint_m": [round(shape.width_m, 3), round(shape.depth_m, 3)],
    }


def object_answer(item: MapObject, snapshot: PageSnapshot) -> dict[str, Any]:
    """One object with its distance from the robot and the time since its last sighting."""
    pose = snapshot.result.pose_map_base
    away_m = math.hypot(item.position_m[0] - pose.x_m, item.position_m[1] - pose.y_m)
    age_s = _age_s(item, snapshot.result)
    seen = item.id in snapshot.result.object_ids
    return map_object_answer(item) | {"distance_m": round(away_m, 3), "age_s": age_s, "in_view": seen}


def _age_s(item: MapObject, result: StepResult) -> float | None:
    """Time since an object was last observed, s; None where that was in an earlier run and a wall time is unknown."""
    if not item.earlier:
        return round(max(0.0, result.frame.stamp_s - item.last_seen_s), 3)
    return None if result.at is None or item.last_seen is None else max(0.0, result.at - item.last_seen)


def objects_answer(snapshot: PageSnapshot | None) -> list[dict[str, Any]]:
    """All objects, the nearest to the robot first."""
    rows = [object_answer(item, snapshot) for item in snapshot.objects] if snapshot else []
    return sorted(rows, key=lambda item: item["distance_m"])


def changes_answer(objects: Sequence[MapObject], annotations: Annotations) -> list[dict[str, Any]]:
    """The history of all objects and of those that have vanished, oldest first."""
    return [change_record(item, event) for item, event in changes([*objects, *annotations.vanished])]


def zones_answer(zones: Sequence[Zone], objects: Sequence[MapObject]) -> list[dict[str, Any]]:
    """The zones, with the ids of the objects whose centre lies in each."""
    return [
        zone_record(zone) | {"objects": [item.id for item in inside_polygon(list(objects), zone.corners_m)]}
        for zone in zones
    ]


def floor_answer(grid: OccupancyGrid | None) -> dict[str, Any]:
    """The observed floor: `runs` of cells row by row, each a value (0 free, 100 obstacle, -1 unknown) and how many
    follow one another; row 0 has the smallest y, its first cell the smallest x. `walls` as in map.json. No rows before
    the first observed floor.
    """
    if grid is None:
        return {"x_m": 0.0, "y_m": 0.0, "cell_m": 0.05, "rows": 0, "columns": 0, "runs": [], "walls": []}
    cells = grid.cells.ravel()
    starts = np.flatnonzero(np.diff(cells, prepend=cells[0] + 1))
    runs = np.column_stack([cells[starts], np.diff(starts, append=len(cells))])
    rows, columns = grid.cells.shape
    return {
        "x_m": round(grid.x_m, 4),
        "y_m": round(grid.y_m, 4),
        "cell_m": grid.cell_m,
        "rows": rows,
        "columns": columns,
        "runs": runs.ravel().tolist(),
        "walls": wall_records(grid),
    }


def rooms_answer(
    objects: Sequence[MapObject], annotations: Annotations, grid: OccupancyGrid | None
) -> dict[str, list[dict[str, Any]]]:
    """`rooms` and `doors` as in map.json."""
    rooms, doors = rooms_of(objects, annotations, grid)
    return {"rooms": [room_record(room) for room in rooms], "doors": [door_record(door) for door in doors]}


def fault_answer(fault: Fault) -> dict[str, Any]:
    """A fault with the frame at which it began, and the remedy: empty where none is known."""
    cause = CAUSE_OF.get(fault.kind)
    return fault.document() | {"remedy": cause.remedy if cause else ""}


def event_answer(event: ZoneEvent) -> dict[str, Any]:
    """An object that came into a zone or left it."""
    return {"stamp_s": event.stamp_s} | event.record()


def boxes(result: StepResult) -> list[dict[str, Any]]:
    """All boxes of a picture, px. distance_m: on the floor, from the robot's centre; None for boxes off the floor."""
    placed = {
        item.sighting.detection: (round(float(np.linalg.norm(item.sighting.position_base_m)), 3), identity)
        for item, identity in zip(result.sightings, result.object_ids, strict=True)
    }
    detections = result.detections
    rows = []
    for index, label in enumerate(detections.labels):
        distance_m, identity = placed.get(index, (None, ""))
        box = [round(float(v), 1) for v in detections.boxes[index]]
        score = round(float(detections.scores[index]), 3)
        rows.append({"box": box, "label": label, "score": score, "distance_m": distance_m, "object": identity})
    return rows
