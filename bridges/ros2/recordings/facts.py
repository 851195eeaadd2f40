"""Metadata beside the ROS 2 messages, so that a replay starts from exactly the same numbers.

Quaternions and integer nanoseconds round in the last bit, and `plumb_bob` covers three of our lens models. Other
programs read the messages.
"""

import json
from dataclasses import asdict
from typing import Any

import msgspec
import numpy as np

from edgemap.geometry.camera.mount import Mount, Platform
from edgemap.geometry.errors import GeometryError
from edgemap.geometry.se2 import SE2
from edgemap.runtime.frames.camera import CameraInfo
from edgemap.runtime.frames.errors import CameraError, OdometryError
from edgemap.runtime.frames.inference import Inference
from edgemap.runtime.frames.reading import Coordinate, Stamp, Strict, decode_json, one_line
from edgemap.runtime.frames.trajectory import Trajectory
from edgemap.runtime.inputs.drives.camera_yaml import LensRecord, Rate

RECORD = "edgemap.recording"  # name of the MCAP metadata record
FORMAT = "edgemap.recording/1"
WHEEL_FILE, TRUTH_FILE = "wheel.json", "truth.json"  # names of MCAP attachments


def facts_record(info: CameraInfo) -> dict[str, str]:
    """A camera as an MCAP metadata record, text to text; floats keep every bit."""
    lens, mount = info.intrinsics, info.mount
    return {
        "format": FORMAT,
        "camera": info.name,
        "rate_hz": json.dumps(info.rate_hz),
        "intrinsics": json.dumps(asdict(lens) if lens else None),
        "mount": json.dumps(asdict(mount) if mount else None),
        "inference": json.dumps(asdict(info.inference) if info.inference else None),
        "calibration": json.dumps(info.calibration or None),
    }


class _RecordedMount(Strict):
    height_m: Coordinate
    pitch_rad: Coordinate
    roll_rad: Coordinate
    forward_m: Coordinate
    left_m: Coordinate
    platform: Platform = Platform.ROBOT


def read_facts(record: dict[str, str], where: str) -> CameraInfo:
    """The camera of a metadata record. where: for messages. Raises CameraError for a damaged one."""
    where = f"{where}: damaged {RECORD} record"
    if missing := {"format", "camera", "rate_hz", "intrinsics", "mount"} - record.keys():
        raise CameraError(f"{where}: lacks {', '.join(sorted(missing))}")
    if record["format"] != FORMAT:
        raise CameraError(f"{where}: format {one_line(record['format'])!r}, this edgemap reads {FORMAT!r}")

    def value(name: str, kind: Any) -> Any:
        optional: Any = kind | None
        return decode_json(record.get(name, "null"), optional, f"{where}: {name}", CameraError)

    lens, mount = value("intrinsics", LensRecord), value("mount", _RecordedMount)
    try:
        return CameraInfo(
            one_line(record["camera"]),
            intrinsics=lens and lens.intrinsics(),
            mount=mount and Mount(**msgspec.structs.asdict(mount)),
            rate_hz=value("rate_hz", Rate),
            inference=value("inference", Inference),
            calibration=value("calibration", dict[str, Any]) or {},
        )
    except GeometryError as error:
        raise CameraError(f"{where}: {error}") from None


def trajectory_file(trajectory: Trajectory) -> bytes:
    """Rows [stamp_s, x_m, y_m, yaw_rad] as JSON."""
    poses = zip(trajectory.stamps_s, trajectory.poses, strict=True)
    return json.dumps([[float(stamp), pose.x_m, pose.y_m, pose.yaw_rad] for stamp, pose in poses]).encode()


def read_trajectory_file(data: bytes, where: str) -> Trajectory:
    """The rows again, bit for bit. where: for messages. Raises CameraError for damaged ones."""
    rows = decode_json(data, list[tuple[Stamp, Coordinate, Coordinate, Coordinate]], where, CameraError)
    try:
        return Trajectory(np.array([row[0] for row in rows], dtype=np.float64), tuple(SE2(*row[1:]) for row in rows))
    except OdometryError as error:
        raise CameraError(f"{where}: {error}") from None
