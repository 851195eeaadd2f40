"""Inertial samples out of a recording, in the pictures' optical frame."""

from typing import Any

import numpy as np

from edgemap.geometry.camera.imu import ImuSamples
from edgemap.runtime.cameras.imu_buffer import ImuBuffer
from edgemap.runtime.errors import CameraError
from edgemap.runtime.messages.stamps import ns_of, to_s
from edgemap.runtime.messages.tf_tree import TfTree
from edgemap.runtime.messages.topics import IMU
from edgemap.runtime.number_rows import ROW_LIMIT
from edgemap.runtime.recordings.reader import McapReading

KIND = "sensor_msgs/Imu"


def recorded_imu(recording: McapReading) -> ImuSamples | None:
    """What edgemap recorded, in the optical frame already; None where there is nothing. Raises CameraError."""
    return _read(recording, IMU, ImuBuffer(kept=None)) if IMU in recording.topics else None


def imu_of(recording: McapReading, tree: TfTree, optical: str, topic: str | None = None) -> ImuSamples | None:
    """The first sensor_msgs/Imu topic of a bag (or the one that is named) whose frame tf joins to the pictures'.

    None where there is none. optical: the pictures' frame. Raises CameraError, also for a named topic that cannot be
    used.
    """
    found = [name for name, known in recording.topics.items() if known.kind == KIND and known.count]
    if topic is not None and topic not in found:
        raise CameraError(f"{recording.path}: no {KIND} topic {topic} (there are: {', '.join(found) or 'none'})")
    for name in found if topic is None else [topic]:
        first = next(recording.messages(name), None)
        pose = tree.pose(optical, first[1]().header.frame_id) if first else None
        if pose is not None:
            return _read(recording, name, ImuBuffer(pose[0], kept=None))
    if topic is not None:
        raise CameraError(f"{recording.path}: tf does not join the frame of {topic} to the pictures' ({optical})")
    return None


def push_message(buffer: ImuBuffer, message: Any, stamp_s: float) -> None:
    """A decoded sensor_msgs/Imu into a buffer. A covariance that starts with -1 says that there is no such value."""
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
