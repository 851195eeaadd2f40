"""What edgemap keeps beside the ROS 2 messages, so that a replay starts from the very same numbers.

Quaternions and whole nanoseconds round in the last bit, and `plumb_bob` stands for three of our lens models; the
messages are for everybody else.
"""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from edgemap.geometry.camera.intrinsics import Distortion, Intrinsics
from edgemap.geometry.camera.mount import Mount
from edgemap.geometry.se2 import SE2
from edgemap.runtime.trajectory import Trajectory

RECORD = "edgemap.recording"  # name of the MCAP metadata record
FORMAT = "edgemap.recording/1"
WHEEL_FILE, TRUTH_FILE = "wheel.json", "truth.json"  # names of MCAP attachments


@dataclass(frozen=True, slots=True)
class Facts:
    """What a camera knew of itself when it was recorded."""

    camera: str
    intrinsics: Intrinsics | None = None
    mount: Mount | None = None
    rate_hz: float | None = None


def facts_record(facts: Facts) -> dict[str, str]:
    """The facts as an MCAP metadata record, text to text; floats keep every bit."""
    lens, mount = facts.intrinsics, facts.mount
    return {
        "format": FORMAT,
        "camera": facts.camera,
        "rate_hz": json.dumps(facts.rate_hz),
        "intrinsics": json.dumps(asdict(lens) if lens else None),
        "mount": json.dumps(asdict(mount) if mount else None),
    }


def read_facts(record: dict[str, str]) -> Facts:
    """The facts of a metadata record. Raises ValueError, KeyError, TypeError or GeometryError for a damaged one."""
    if record["format"] != FORMAT:
        raise ValueError(f"format {record['format']!r}, this edgemap reads {FORMAT!r}")
    lens, mount = json.loads(record["intrinsics"]), json.loads(record["mount"])
    if lens is not None:
        distortion = lens.pop("distortion")
        lens = Intrinsics(**lens, distortion=Distortion(distortion["model"], tuple(distortion["coefficients"])))
    return Facts(record["camera"], lens, Mount(**mount) if mount else None, json.loads(record["rate_hz"]))


def trajectory_file(trajectory: Trajectory) -> bytes:
    """Rows [stamp_s, x_m, y_m, yaw_rad] as JSON."""
    poses = zip(trajectory.stamps_s, trajectory.poses, strict=True)
    return json.dumps([[float(stamp), pose.x_m, pose.y_m, pose.yaw_rad] for stamp, pose in poses]).encode()


def read_trajectory_file(data: bytes) -> Trajectory:
    """The rows again, bit for bit. Raises ValueError or OdometryError for damaged ones."""
    rows: Any = np.array(json.loads(data), dtype=np.float64).reshape(-1, 4)
    return Trajectory(rows[:, 0], tuple(SE2(*row[1:]) for row in rows.tolist()))
