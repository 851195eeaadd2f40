"""Wheel odometry and inertial samples on ROS 2 topics, beside any camera."""

import time
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from edgemap.geometry.se2 import SE2
from edgemap.runtime.frames.errors import CameraError
from edgemap.runtime.frames.frame import Frame
from edgemap.runtime.frames.growing_track import GrowingTrack
from edgemap.runtime.frames.messages.stamps import ns_of, ros_offset_s, to_s
from edgemap.runtime.frames.messages.tf_tree import planar_pose
from edgemap.runtime.frames.messages.topics import IMU, KINDS, WHEEL
from edgemap.runtime.frames.trajectory import PoseTrack
from edgemap.runtime.inputs.cameras.around import CameraAround
from edgemap.runtime.inputs.cameras.imu_buffer import ImuBuffer
from edgemap.runtime.inputs.cameras.protocol import Camera, SensorTopics
from edgemap.runtime.inputs.recordings.sensors import push_message
from edgemap.runtime.inputs.ros2.camera import Ros2Camera
from edgemap.runtime.inputs.ros2.node import Node, Subscription
from edgemap.runtime.inputs.ros2.tf import TfListener

FIRST_S = 5.0  # wait for the first sample
LATE_S = 0.05  # how long a step waits for the wheels' pose of its own stamp


class WheelTopic(GrowingTrack):
    """nav_msgs/Odometry of the wheels, looked up by stamps of the stream, s. offset_s: from there to ROS time."""

    def __init__(self, node: Node, topic: str) -> None:
        super().__init__()
        self._name, self.offset_s = f"ros2:{topic}", 0.0
        self._messages = node.subscription(topic, KINDS[WHEEL], depth=500)

    def __str__(self) -> str:
        return self._name

    def at(self, stamp_s: float, tolerance_s: float = 0.0) -> SE2:
        """The pose as of a GrowingTrack, after waiting up to `LATE_S` for messages."""
        until_s = time.monotonic() + LATE_S
        self._take()
        while self._newest_s < stamp_s and self._messages.wait(until_s - time.monotonic()):
            self._take()
        return super().at(stamp_s, tolerance_s)

    def _take(self) -> None:
        for message in self._messages.take():
            with suppress(CameraError):  # what is no pose is none
                pose = planar_pose(message.pose.pose, self._name)
                self.push(to_s(ns_of(message.header.stamp)) - self.offset_s, pose)


class Ros2SensorsCamera(CameraAround):
    """A camera with wheels or an IMU on ROS 2 topics.

    Raises CameraError where the IMU is silent or tf lacks its rotation to the camera.
    """

    def __init__(self, camera: Camera, node: Node, topics: SensorTopics) -> None:
        super().__init__(camera)
        by_ros = isinstance(camera, Ros2Camera)
        self._offset_s: float | None = 0.0 if by_ros else None
        self._wheels = WheelTopic(node, topics.wheels) if topics.wheels is not None else None
        self.wheel: Path | PoseTrack | None = self._wheels or camera.wheel
        self._buffer = self._samples = None
        if topics.imu is not None:
            self._samples = node.subscription(topics.imu, KINDS[IMU], depth=2000)
            self._buffer = ImuBuffer(
                _rotation(node, topics.imu, self._samples, camera.optical if by_ros else topics.optical)
            )

    def read(self) -> Frame | None:
        """The next frame of the camera behind, with the samples up to its stamp."""
        frame = super().read()
        if frame is None:
            return None
        if self._offset_s is None:
            self._offset_s = ros_offset_s(frame.stamp_s, time.time(), time.monotonic())
            if self._wheels is not None:
                self._wheels.offset_s = self._offset_s
        if self._buffer is None or self._samples is None:
            return frame
        for message in self._samples.take():
            push_message(self._buffer, message, to_s(ns_of(message.header.stamp)) - self._offset_s)
        return replace(frame, imu=self._buffer.take(frame.stamp_s))


def _rotation(node: Node, imu: str, samples: Subscription, optical: str) -> NDArray[np.float64]:
    """From the IMU's axes to the camera's optical ones. Raises CameraError."""
    listener = TfListener(node, f"ros2:{imu}")
    first = samples.newest() if samples.wait(FIRST_S) else None
    if first is None:
        raise CameraError(f"ros2:{imu}: no sensor_msgs/Imu within {FIRST_S:.0f} s")
    frame = first.header.frame_id
    pose = listener.ask(lambda tree: tree.pose(optical, frame))
    if pose is None:
        raise CameraError(f"ros2:{imu}: tf does not join its frame ({frame}) to the pictures' ({optical})")
    return pose[0]
