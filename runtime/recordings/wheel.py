"""Wheel odometry out of a recording."""

import numpy as np

from edgemap.geometry.se2 import SE2
from edgemap.runtime.drives.sensor_csv import check_speed
from edgemap.runtime.errors import CameraError, OdometryError
from edgemap.runtime.messages.poses import planar_pose
from edgemap.runtime.messages.stamps import ns_of, to_s
from edgemap.runtime.messages.topics import ODOMETRY, TRUTH
from edgemap.runtime.number_rows import ROW_LIMIT
from edgemap.runtime.reading import user_path
from edgemap.runtime.recordings.facts import WHEEL_FILE, read_trajectory_file
from edgemap.runtime.recordings.reader import McapReading
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
    recording = McapReading(user_path(file))
    try:
        if not topic and WHEEL_FILE in recording.attachments:
            return read_trajectory_file(recording.attachments[WHEEL_FILE], f"{file}: {WHEEL_FILE}")
        found = [
            name for name, known in recording.topics.items() if known.kind == KIND and name not in (TRUTH, ODOMETRY)
        ]
        if not found or (topic and topic not in found):
            there = ", ".join(found) or "none"
            raise CameraError(f"{file}: no {KIND} topic {topic or 'of wheels'} (there are: {there})")
        poses: dict[int, SE2] = {}
        for log_ns, decode in recording.messages(topic or found[0]):
            message = decode()
            stamp_ns = ns_of(message.header.stamp) or log_ns
            poses[stamp_ns] = planar_pose(message.pose.pose, f"{file}: {topic or found[0]} at {to_s(stamp_ns):.3f} s")
            if len(poses) > ROW_LIMIT:
                raise CameraError(f"{file}: {topic or found[0]}: more than {ROW_LIMIT:,} poses")
        stamps = sorted(poses)
        if not stamps:
            raise CameraError(f"{file}: {topic or found[0]} has no message")
        stamps_s = np.array([to_s(stamp) for stamp in stamps])
        positions_m = np.array([(poses[stamp].x_m, poses[stamp].y_m) for stamp in stamps])
        check_speed(f"{file}: message", stamps_s, positions_m, list(range(len(stamps))))
        return Trajectory(stamps_s, tuple(poses[stamp] for stamp in stamps))
    except OdometryError as error:
        raise CameraError(f"{file}: {error}") from None
    finally:
        recording.close()
