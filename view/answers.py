"""What the page and the API say of a run, as plain JSON values: one wording for the socket and for every request."""

from __future__ import annotations

import math
import time
from typing import Any

import msgspec
import numpy as np

from edgemap.geometry.objects.map_object import MapObject, radius_m
from edgemap.geometry.objects.queries import inside_polygon
from edgemap.runtime.map_file import object_record, zone_record
from edgemap.runtime.slam import StepResult
from edgemap.view.page import Fault, LivePage, Moment
from edgemap.view.status import pose_sigma, status, step_ms

ENCODER = msgspec.json.Encoder(enc_hook=float)  # numpy's numbers


def health_answer(page: LivePage, vitals: dict[str, float | None]) -> dict[str, Any]:
    """Status, camera, speed and load."""
    moment = page.newest
    return {
        "state": page.state,
        "camera_state": page.camera_state(),
        "status": status(page),
        "rate_hz": page.rate_hz(),
        "step_ms": round(step_ms(moment.result), 3) if moment else None,
        "age_s": round(time.monotonic() - moment.arrived_s, 3) if moment else None,
        "vitals": vitals,
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
    """What the newest picture shows, and how long each stage took."""
    return {
        "frame": result.frame.index,
        "stamp_s": result.frame.stamp_s,
        "boxes": boxes(result),
        "stages_ms": result.stages_ms,
        "motion_fault": result.motion.fault,
    }


def map_object_answer(item: MapObject) -> dict[str, Any]:
    """One object as in map.json, with the radius of a circle that takes as much floor."""
    return object_record(item) | {"radius_m": round(radius_m(item), 3)}


def object_answer(item: MapObject, moment: Moment) -> dict[str, Any]:
    """One object with its distance from the robot and the time since it was last seen."""
    pose = moment.result.pose_map_base
    away_m = math.hypot(item.position_m[0] - pose.x_m, item.position_m[1] - pose.y_m)
    age_s = max(0.0, moment.result.frame.stamp_s - item.last_seen_s)
    seen = item.id in moment.result.object_ids
    return map_object_answer(item) | {"distance_m": round(away_m, 3), "age_s": round(age_s, 3), "in_view": seen}


def objects_answer(moment: Moment | None) -> list[dict[str, Any]]:
    """All objects, the nearest to the robot first."""
    found = [object_answer(item, moment) for item in moment.objects] if moment else []
    return sorted(found, key=lambda item: item["distance_m"])


def zones_answer(page: LivePage) -> list[dict[str, Any]]:
    """The zones, with the ids of the objects whose centre lies in each."""
    return [
        zone_record(zone) | {"objects": [item.id for item in inside_polygon(page.objects, zone.corners_m)]}
        for zone in page.annotations.zones
    ]


def fault_answer(fault: Fault) -> dict[str, Any]:
    """A fault with the frame it began at."""
    return {"frame": fault.frame, "text": fault.text}


def boxes(result: StepResult) -> list[dict[str, Any]]:
    """All boxes of a picture, px; distance_m from the robot's centre on the floor, None where it stands on none."""
    placed = {
        item.sighting.detection: (round(float(np.linalg.norm(item.sighting.position_base_m)), 3), identity)
        for item, identity in zip(result.sightings, result.object_ids, strict=True)
    }
    found = result.detections
    rows = []
    for index, label in enumerate(found.labels):
        distance_m, identity = placed.get(index, (None, ""))
        box = [round(float(v), 1) for v in found.boxes[index]]
        score = round(float(found.scores[index]), 3)
        rows.append({"box": box, "label": label, "score": score, "distance_m": distance_m, "object": identity})
    return rows


def plain(value: Any) -> bytes:
    """JSON bytes."""
    return ENCODER.encode(value)
