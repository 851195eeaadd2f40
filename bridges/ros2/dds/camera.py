"""`--camera ros2:/topic`: pictures of a ROS 2 camera, with calibration and mount from CameraInfo and tf; and a camera
with wheels or an IMU on ROS 2 topics."""

import time
from dataclasses import replace
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from edgemap.bridges.ros2.dds.depth import DepthTopic
from edgemap.bridges.ros2.dds.node import Node, Subscription, wait_for
from edgemap.bridges.ros2.dds.sources import WAIT_S, TfListener, WheelTopic
from edgemap.bridges.ros2.dds.tf_poses import live_tf_poses
from edgemap.bridges.ros2.messages.definitions import RosClock, ns_of, to_s
from edgemap.bridges.ros2.messages.topics import IMU, INFO
from edgemap.bridges.ros2.recordings.foreign import FLOOR_FRAME, info_topics, lens_of, mount_of, push_message
from edgemap.bridges.ros2.recordings.pictures import PICTURE_KINDS
from edgemap.bridges.ros2.recordings.reading import short
from edgemap.geometry.camera.intrinsics import Intrinsics
from edgemap.runtime.frames.camera import Camera, CameraOptions, Driver, Picture, SensorTopics
from edgemap.runtime.frames.errors import CameraError
from edgemap.runtime.frames.frame import Frame
from edgemap.runtime.frames.limits import EVERY_S, TICK_S
from edgemap.runtime.frames.reading import print_message
from edgemap.runtime.inputs.cameras.imu_buffer import ImuBuffer
from edgemap.runtime.inputs.cameras.live import LiveCamera
from edgemap.runtime.inputs.cameras.wrappers import CameraAround
from edgemap.runtime.inputs.drives.pictures import Levels


class Ros2Topic(Driver):
    """A topic with pictures, and depth beside them: the driver, and while it is open the device, which is open since
    its first picture. Stamps are the messages'. frame_id: as the first message names its frame."""

    size: tuple[int, int]
    intrinsics: Intrinsics | None
    rate_hz: float | None = None
    frame_id: str

    def __init__(self, node: Node, topic: str, depth: DepthTopic | None = None) -> None:
        self.name = f"ros2:{topic}"
        self._node, self._topic, self._depth, self._levels = node, topic, depth, Levels()

    def open(self) -> Self:
        """Subscribe. Raises CameraError where no such topic is published, or no picture arrives."""
        kind = wait_for(lambda: self._node.published().get(self._topic), WAIT_S)
        if kind is None or short(kind) not in PICTURE_KINDS:
            published = sorted(self._node.published().items())
            others = ", ".join(name for name, known in published if short(known) in PICTURE_KINDS) or "none"
            what = f"{self._topic} is {kind}, not pictures" if kind else f"nobody publishes {self._topic}"
            raise CameraError(f"camera {self.name}: {what} within {WAIT_S:.0f} s (topics with pictures: {others})")
        self._decode = PICTURE_KINDS[short(kind)]
        # Asked for before the first picture, so that they come beside it.
        infos = [Subscription(self._node, info, INFO.kind) for info in info_topics(self._topic)]
        self._pictures = Subscription(self._node, self._topic, kind, depth=2)
        self._first = self._next(WAIT_S)
        if self._first is None:
            raise CameraError(f"camera {self.name}: no picture on {self._topic} within {WAIT_S:.0f} s")
        _, image, self.frame_id = self._first
        self.size = (image.shape[1], image.shape[0])
        info = wait_for(
            lambda: next((message for one in infos if (message := one.newest()) is not None), None), EVERY_S
        )
        self.intrinsics = lens_of(info, self._topic, self.name, self.size) if info else None
        return self

    def grab(self) -> Picture | None:
        """The newest picture; None where none came. Raises CameraError or BridgeError for one that is damaged."""
        grabbed, self._first = self._first or self._next(TICK_S), None
        if grabbed is None:
            return None
        stamp_s, image, _ = grabbed
        return Picture(stamp_s, image, None if self._depth is None else self._depth.at(stamp_s, self.intrinsics))

    def close(self) -> None:
        """Unsubscribe."""
        self._pictures.close()
        if self._depth is not None:
            self._depth.close()

    def _next(self, timeout_s: float) -> tuple[float, Any, str] | None:
        message = self._pictures.newest(timeout_s)
        if message is None:
            return None
        stamp_s = to_s(ns_of(message.header.stamp)) or time.time()
        return stamp_s, self._decode(message, self.name, self._levels), message.header.frame_id


class Ros2Camera(LiveCamera):
    """A topic with pictures as a live camera. optical: the frame that its messages name. Raises CameraError as the
    topic does, and for an invalid transform."""

    def __init__(self, node: Node, topic: str, how: CameraOptions = CameraOptions()) -> None:  # noqa: B008
        device = Ros2Topic(node, topic, DepthTopic(node, how.topics.depth) if how.depth else None)
        listener = TfListener(node, device.name)
        super().__init__(device, how)
        self.optical = optical = device.frame_id
        self.update_info(tf=live_tf_poses(node, device.name, lambda: -self.clock_offset_s))
        if how.mount is None:
            listener.ask(lambda tree: tree.pose(FLOOR_FRAME, optical))
            mount, text = listener.ask(lambda tree: mount_of(tree, optical, how.rotate)) or (None, "")
            if text:
                print_message(f"{device.name}: {text}")
            self.update_info(mount=mount)


class Ros2SensorsCamera(CameraAround):
    """A camera with wheels or an IMU on ROS 2 topics.

    Raises CameraError where the IMU is silent or tf lacks its rotation to the camera.
    """

    def __init__(self, camera: Camera, node: Node, topics: SensorTopics) -> None:
        super().__init__(camera)
        by_ros = isinstance(camera, Ros2Camera)
        self._clock = RosClock((lambda: -camera.clock_offset_s) if by_ros else None)
        self._offset_s = 0.0
        if topics.wheels is not None:
            self.update_info(wheel=WheelTopic(node, topics.wheels, lambda: self._offset_s))
        self._imu: tuple[Subscription, ImuBuffer] | None = None
        if topics.imu is not None:
            samples = Subscription(node, topics.imu, IMU.kind, depth=2000)
            optical = camera.optical if by_ros else topics.optical
            self._imu = samples, ImuBuffer(_rotation(node, topics.imu, samples, optical))

    def read(self) -> Frame | None:
        """The next frame of the camera behind, with the samples up to its stamp."""
        frame = super().read()
        if frame is None:
            return None
        self._offset_s = self._clock.offset_s(frame.stamp_s)
        if self._imu is None:
            return frame
        samples, buffer = self._imu
        for message in samples.take():
            push_message(buffer, message, to_s(ns_of(message.header.stamp)) - self._offset_s)
        return replace(frame, imu=buffer.take(frame.stamp_s))


def _rotation(node: Node, imu: str, samples: Subscription, optical: str) -> NDArray[np.float64]:
    """From the IMU's axes to the camera's optical ones. Raises CameraError."""
    listener = TfListener(node, f"ros2:{imu}")
    first = samples.newest(WAIT_S)
    if first is None:
        raise CameraError(f"ros2:{imu}: no sensor_msgs/Imu within {WAIT_S:.0f} s")
    frame = first.header.frame_id
    pose = listener.ask(lambda tree: tree.pose(optical, frame))
    if pose is None:
        raise CameraError(f"ros2:{imu}: tf does not join its frame ({frame}) to the pictures' ({optical})")
    return pose[:3, :3]
