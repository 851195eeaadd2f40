"""Inertial samples, in the pictures' optical frame, and wheel odometry out of a recording."""

from typing import Any

import numpy as np

from edgemap.geometry.camera.imu import ImuSamples
from edgemap.geometry.se2 import SE2
from edgemap.runtime.frames.errors import CameraError, OdometryError
from edgemap.runtime.frames.messages.stamps import ns_of, to_s
from edgemap.runtime.frames.messages.tf_tree import TfTree, planar_pose
from edgemap.runtime.frames.messages.topics import IMU, ODOMETRY, TRUTH
from edgemap.runtime.frames.number_rows import ROW_LIMIT
from edgemap.runtime.frames.reading import user_path
from edgemap.runtime.frames.trajectory import Trajectory
from edgemap.runtime.inputs.cameras.imu_buffer import ImuBuffer
from edgemap.runtime.inputs.drives.sensor_csv import check_speed
from edgemap.runtime.inputs.recordings.facts import WHEEL_FILE, read_trajectory_file
from edgemap.runtime.inputs.recordings.reader import McapReading

IMU_KIND = "sensor_msgs/Imu"
WHEEL_KIND = "nav_msgs/Odometry"


def recorded_imu(recording: McapReading) -> ImuSamples | None:
    """The IMU samples that edgemap recorded, in the optical frame; None where there are none. Raises CameraError."""
    return _read(recording, IMU, ImuBuffer(kept=None)) if IMU in recording.topics else None


def imu_of(recording: McapReading, tree: TfTree, optical: str, topic: str | None = None) -> ImuSamples | None:
    """The first sensor_msgs/Imu topic of a bag, or the named one, whose frame tf connects to the pictures'.

    None where there is none. optical: the pictures' frame. Raises CameraError, also for a named topic that cannot be
    used.
    """
    found = [name for name, known in recording.topics.items() if known.kind == IMU_KIND and known.count]
    if topic is not None and topic not in found:
        raise CameraError(f"{recording.path}: no {IMU_KIND} topic {topic} (there are: {', '.join(found) or 'none'})")
    for name in found if topic is None else [topic]:
        first = next(recording.messages(name), None)
        pose = tree.pose(optical, first[1]().header.frame_id) if first else None
        if pose is not None:
            return _read(recording, name, ImuBuffer(pose[0], kept=None))
    if topic is not None:
        raise CameraError(f"{recording.path}: tf does not join the frame of {topic} to the pictures' ({optical})")
    return None


def push_message(buffer: ImuBuffer, message: Any, stamp_s: float) -> None:
    """Adds a decoded sensor_msgs/Imu to a buffer. A covariance that starts with -1 marks a missing value."""
    rate, force = message.angular_velocity, message.linear_acceleration
    if message.linear_acceleration_covariance[0] != -1.0:
        buffer.push_force(stamp_s, (force.x, force.y, force.z))
    if message.angular_velocity_covariance[0] != -1.0:
        buffer.push_rate(stamp_s, (rate.x, rate.y, rate.z))


def _read(recording: McapReading, topic: str, buffer: ImuBuffer) -> ImuSamples | None:
    for number, (log_ns, decode) in enumerate(recording.messages(topic)):
        if number >= ROW_LIMIT:
            raise CameraError(f"{recording.path}: {topic}: more than {ROW_LIMIT:,} samples")
        message = decode()
        push_message(buffer, message, to_s(ns_of(message.header.stamp) or log_ns))
    samples = buffer.take(np.inf)
    return samples if len(samples) else None


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
            name
            for name, known in recording.topics.items()
            if known.kind == WHEEL_KIND and name not in (TRUTH, ODOMETRY)
        ]
        if not found or (topic and topic not in found):
            there = ", ".join(found) or "none"
            raise CameraError(f"{file}: no {WHEEL_KIND} topic {topic or 'of wheels'} (there are: {there})")
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
