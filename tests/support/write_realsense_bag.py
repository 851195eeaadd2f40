"""Writes a ROS 1 bag in librealsense's topic layout, file version 4, with depth beside colour as devices record it."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.rosbag1 import Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

STREAM_INFO = "uint32 fps\nstring encoding\nbool is_recommended\n"
STATIC_NS = 1  # librealsense keeps what does not change at this stamp


class BagWriter:
    """One bag: messages by topic, type and stamp in nanoseconds."""

    def __init__(self, writer: Writer) -> None:
        self.store = get_typestore(Stores.ROS1_NOETIC)
        self.store.register(get_types_from_msg(STREAM_INFO, "realsense_msgs/msg/StreamInfo"))
        self.writer, self.connections = writer, {}

    def make(self, kind: str, *fields: Any) -> Any:
        return self.store.types[kind](*fields)

    def put(self, topic: str, kind: str, message: Any, stamp_ns: int = STATIC_NS) -> None:
        if topic not in self.connections:
            self.connections[topic] = self.writer.add_connection(topic, kind, typestore=self.store)
        self.writer.write(self.connections[topic], stamp_ns, self.store.serialize_ros1(message, kind))

    def key_value(self, topic: str, key: str, value: str, stamp_ns: int = STATIC_NS) -> None:
        kind = "diagnostic_msgs/msg/KeyValue"
        self.put(topic, kind, self.make(kind, key, value), stamp_ns)

    def header(self, number: int, stamp_s: float) -> Any:
        seconds = int(stamp_s)
        time = self.make("builtin_interfaces/msg/Time", seconds, round((stamp_s - seconds) * 1e9))
        return self.make("std_msgs/msg/Header", number, time, "0")

    def stream(self, topic: str, encoding: str, lens: Sequence[float], size: tuple[int, int]) -> None:
        width, height = size
        fx, fy, cx, cy = lens
        info = "realsense_msgs/msg/StreamInfo"
        self.put(f"{topic}/info", info, self.make(info, 30, encoding, True))
        camera = "sensor_msgs/msg/CameraInfo"
        region = self.make("sensor_msgs/msg/RegionOfInterest", 0, 0, 0, 0, False)
        k = np.array([fx, 0, cx, 0, fy, cy, 0, 0, 1.0])
        fields = ("Inverse Brown Conrady", np.zeros(5), k, np.zeros(9), np.zeros(12), 0, 0, region)
        self.put(f"{topic}/info/camera_info", camera, self.make(camera, self.header(0, 0.0), height, width, *fields))
        transform = "geometry_msgs/msg/Transform"
        zero = self.make("geometry_msgs/msg/Vector3", 0.0, 0.0, 0.0)
        level = self.make("geometry_msgs/msg/Quaternion", 0.0, 0.0, 0.0, 1.0)
        self.put(f"{topic}/tf/0", transform, self.make(transform, zero, level))

    def picture(self, topic: str, encoding: str, number: int, stamp_s: float, picture: np.ndarray, at_ns: int) -> None:
        height, width = picture.shape[:2]
        data = np.ascontiguousarray(picture).view(np.uint8).reshape(-1)
        kind = "sensor_msgs/msg/Image"
        fields = (height, width, encoding, 0, data.size // height, data)
        self.put(f"{topic}/image/data", kind, self.make(kind, self.header(number, stamp_s), *fields), at_ns)
        self.key_value(f"{topic}/image/metadata", "timestamp_domain", "Hardware Clock", at_ns)


def write_realsense_bag(
    path: Path, pictures: Sequence[np.ndarray], stamps_s: Sequence[float], lens: tuple[float, float, float, float]
) -> Path:
    """Write rgb8 pictures, (H, W, 3), at stamps in seconds, with an empty 16-bit depth picture beside each."""
    height, width = pictures[0].shape[:2]
    depth, colour = "/device_0/sensor_0/Depth_0", "/device_0/sensor_1/Color_0"
    with Writer(path) as writer:
        bag = BagWriter(writer)
        bag.put("/file_version", "std_msgs/msg/UInt32", bag.make("std_msgs/msg/UInt32", 4))
        for key, value in (("Name", "Intel RealSense D435"), ("Serial Number", "1"), ("Product Id", "0B07")):
            bag.key_value("/device_0/info", key, value)
        bag.key_value("/device_0/sensor_0/info", "Name", "Stereo Module")
        bag.key_value("/device_0/sensor_1/info", "Name", "RGB Camera")
        bag.stream(depth, "mono16", lens, (width, height))
        bag.stream(colour, "rgb8", lens, (width, height))
        for i, (picture, stamp) in enumerate(zip(pictures, stamps_s, strict=True)):
            at_ns = 1_000_000 + round((stamp - stamps_s[0]) * 1e9)
            bag.picture(depth, "mono16", i + 1, stamp, np.zeros((height, width), np.uint16), at_ns)
            bag.picture(colour, "rgb8", i + 1, stamp, picture, at_ns + 1000)
    return path
