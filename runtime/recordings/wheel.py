"""Wheel odometry out of a recording."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np

from edgemap.geometry.se2 import SE2
from edgemap.runtime.errors import CameraError
from edgemap.runtime.recordings.facts import WHEEL_FILE, read_trajectory_file
from edgemap.runtime.recordings.reader import McapReading
from edgemap.runtime.recordings.stamps import ns_of, to_s
from edgemap.runtime.recordings.topics import ODOMETRY, TRUTH
from edgemap.runtime.trajectory import Trajectory

KIND = "nav_msgs/Odometry"


def is_recording(spec: str) -> bool:
    """Whether a wheel SPEC names a recording (`FILE.mcap[#/topic]`) and not a CSV."""
    return spec.partition("#")[0].endswith(".mcap")


def read_wheel(spec: str) -> Trajectory:
    """The wheels' own poses in `FILE.mcap[#/topic]`: what edgemap recorded, or else the first nav_msgs/Odometry topic.

    Poses of the base as the wheels integrate them, at the headers' stamps. Raises CameraError.
    """
    file, _, topic = spec.partition("#")
    recording = McapReading(Path(file).expanduser())
    try:
        if not topic and WHEEL_FILE in recording.attachments:
            return read_trajectory_file(recording.attachments[WHEEL_FILE])
        found = [
            name for name, known in recording.topics.items() if known.kind == KIND and name not in (TRUTH, ODOMETRY)
        ]
        if not found or (topic and topic not in found):
            there = ", ".join(found) or "none"
            raise CameraError(f"{file}: no {KIND} topic {topic or 'of wheels'} (there are: {there})")
        poses: dict[int, SE2] = {}
        for log_ns, decode in recording.messages(topic or found[0]):
            message = decode()
            poses[ns_of(message.header.stamp) or log_ns] = _pose(message.pose.pose)
        stamps = sorted(poses)
        return Trajectory(np.array([to_s(stamp) for stamp in stamps]), tuple(poses[stamp] for stamp in stamps))
    finally:
        recording.close()


def _pose(pose: Any) -> SE2:
    x, y, z, w = (getattr(pose.orientation, axis) for axis in "xyzw")
    return SE2(pose.position.x, pose.position.y, math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z)))
