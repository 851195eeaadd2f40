"""Writes ROS 2 bags in MCAP as other people's robots do, with rosbags: nothing of edgemap in it."""

from pathlib import Path
from typing import Any

import numpy as np
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore
from scipy.spatial.transform import Rotation

STORE = get_typestore(Stores.ROS2_JAZZY)


def make(kind: str, *fields: Any) -> Any:
    return STORE.types[kind](*fields)


def header(stamp_ns: int, frame_id: str) -> Any:
    time = make("builtin_interfaces/msg/Time", stamp_ns // 10**9, stamp_ns % 10**9)
    return make("std_msgs/msg/Header", time, frame_id)


def image(stamp_ns: int, picture: np.ndarray, encoding: str, pad: int = 0) -> Any:
    """sensor_msgs/Image; pad: bytes of rubbish at the end of each row."""
    rows = picture.reshape(picture.shape[0], -1)
    rows = np.hstack([rows, np.full((len(rows), pad), 7, np.uint8)])
    height, width = picture.shape[:2]
    head = header(stamp_ns, "cam_optical")
    return make("sensor_msgs/msg/Image", head, height, width, encoding, 0, rows.shape[1], rows.reshape(-1))


def compressed(stamp_ns: int, data: bytes, form: str) -> Any:
    head = header(stamp_ns, "cam_optical")
    return make("sensor_msgs/msg/CompressedImage", head, form, np.frombuffer(data, np.uint8))


def camera_info(width: int, height: int, k: list[float], d: list[float], model: str = "plumb_bob") -> Any:
    region = make("sensor_msgs/msg/RegionOfInterest", 0, 0, 0, 0, False)
    p = np.array([*k[:3], 0.0, *k[3:6], 0.0, *k[6:], 0.0])
    return make(
        "sensor_msgs/msg/CameraInfo", header(1, "cam_optical"), height, width, model, np.array(d), np.array(k),
        np.eye(3).ravel(), p, 0, 0, region,
    )  # fmt: skip


def transform(parent: str, child: str, place: tuple[float, float, float], rpy_deg: tuple[float, float, float]) -> Any:
    """geometry_msgs/TransformStamped, angles as in URDF: roll, pitch, yaw about fixed axes."""
    q = Rotation.from_euler("xyz", rpy_deg, degrees=True).as_quat()
    at, turn = make("geometry_msgs/msg/Vector3", *place), make("geometry_msgs/msg/Quaternion", *q)
    body = make("geometry_msgs/msg/Transform", at, turn)
    return make("geometry_msgs/msg/TransformStamped", header(1, parent), child, body)


def tf(*transforms: Any) -> Any:
    return make("tf2_msgs/msg/TFMessage", list(transforms))


def pose(x: float, y: float, yaw: float) -> Any:
    return make(
        "geometry_msgs/msg/Pose",
        make("geometry_msgs/msg/Point", x, y, 0.0),
        make("geometry_msgs/msg/Quaternion", 0.0, 0.0, np.sin(yaw / 2), np.cos(yaw / 2)),
    )


def path(stamp_ns: int, nodes: list[tuple[int, Any]], frame: str = "map") -> Any:
    """nav_msgs/Path of (stamp in ns, `pose`)."""
    poses = [make("geometry_msgs/msg/PoseStamped", header(own_ns, frame), one) for own_ns, one in nodes]
    return make("nav_msgs/msg/Path", header(stamp_ns, frame), poses)


def odometry(stamp_ns: int, x: float, y: float, yaw: float) -> Any:
    zero = make("geometry_msgs/msg/Vector3", 0.0, 0.0, 0.0)
    twist = make("geometry_msgs/msg/Twist", zero, zero)
    return make(
        "nav_msgs/msg/Odometry", header(stamp_ns, "odom"), "base_footprint",
        make("geometry_msgs/msg/PoseWithCovariance", pose(x, y, yaw), np.zeros(36)),
        make("geometry_msgs/msg/TwistWithCovariance", twist, np.zeros(36)),
    )  # fmt: skip


def imu(stamp_ns: int, gyro: tuple[float, float, float], accel: tuple[float, float, float]) -> Any:
    """sensor_msgs/Imu of a part `imu_link`."""
    rate, force = (make("geometry_msgs/msg/Vector3", *values) for values in (gyro, accel))
    return make(
        "sensor_msgs/msg/Imu", header(stamp_ns, "imu_link"), make("geometry_msgs/msg/Quaternion", 0.0, 0.0, 0.0, 1.0),
        np.array([-1.0] + [0.0] * 8), rate, np.zeros(9), force, np.zeros(9),
    )  # fmt: skip


def write_bag(folder: Path, messages: list[tuple[str, int, Any]], plugin: StoragePlugin = StoragePlugin.MCAP) -> Path:
    """(topic, log time in ns, message) into a bag; the path of the file of messages inside its folder."""
    with Writer(folder, version=9, storage_plugin=plugin) as writer:
        connections: dict[str, Any] = {}
        for topic, stamp_ns, message in messages:
            kind = message.__msgtype__
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind, typestore=STORE)
            writer.write(connections[topic], stamp_ns, STORE.serialize_cdr(message, kind))
    (path,) = (file for file in folder.iterdir() if file.name != "metadata.yaml")
    return path
