"""What a run wrote before it knew better, moved: into the saved map that it found itself in, or to a corrected way."""

from __future__ import annotations

import json

from edgemap.geometry.se2 import SE2
from edgemap.geometry.slam.keyframes import TrajectoryCorrection
from edgemap.runtime.trajectory import parse_tum, tum_line


def move_trajectory(text: str, pose_map_start: SE2) -> str:
    """TUM text of poses in the start frame to the same in the map frame."""
    if not text.strip():
        return text
    way = parse_tum(text, "trajectory.tum")
    lines = [tum_line(stamp_s, pose_map_start @ pose) for stamp_s, pose in zip(way.stamps_s, way.poses, strict=True)]
    return "".join(lines)


def move_sightings(text: str, pose_map_start: SE2) -> str:
    """Lines of sightings.jsonl with `map_m` in the start frame to the same in the map frame."""
    lines = []
    for line in text.splitlines():
        record = json.loads(line)
        record["map_m"] = [round(float(value), 4) for value in pose_map_start.apply(record["map_m"])]
        lines.append(json.dumps(record) + "\n")
    return "".join(lines)


def corrected_trajectory(text: str, past: TrajectoryCorrection) -> str:
    """TUM text of poses as they were known then to the same as they are known now."""
    if not text.strip():
        return text
    way = parse_tum(text, "trajectory.tum")
    poses = past.poses(way.stamps_s, [pose.vector() for pose in way.poses])
    return "".join(tum_line(stamp_s, SE2(*pose)) for stamp_s, pose in zip(way.stamps_s, poses, strict=True))


def corrected_sightings(text: str, past: TrajectoryCorrection) -> str:
    """Lines of sightings.jsonl with `map_m` as it was known then to the same as it is known now."""
    records = [json.loads(line) for line in text.splitlines()]
    places = past.points([record["stamp_s"] for record in records], [record["map_m"] for record in records])
    for record, place in zip(records, places.tolist(), strict=True):
        record["map_m"] = [round(value, 4) for value in place]
    return "".join(json.dumps(record) + "\n" for record in records)
