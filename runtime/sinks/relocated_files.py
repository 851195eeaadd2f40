"""What a run wrote before it knew where it was, moved into the frame of the map that it found itself in."""

from __future__ import annotations

import json

from edgemap.geometry.se2 import SE2
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
