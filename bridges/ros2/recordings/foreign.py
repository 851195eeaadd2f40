"""Lens, mount, inertial samples and wheel odometry from the ROS 2 messages of a recording."""

import math
from typing import Any

import numpy as np

from edgemap.bridges.ros2.messages.definitions import ns_of, to_s
from edgemap.bridges.ros2.messages.tf_tree import TfTree, planar_pose
from edgemap.bridges.ros2.messages.topics import IMU, ODOMETRY, TF, TF_STATIC, TRUTH
from edgemap.bridges.ros2.recordings.facts import WHEEL_FILE, read_trajectory_file
from edgemap.bridges.ros2.recordings.reader import McapReading
from edgemap.geometry.camera.imu import ImuSamples
from edgemap.geometry.camera.intrinsics import Distortion, Intrinsics
from edgemap.geometry.camera.mount import Mount
from edgemap.geometry.errors import GeometryError
from edgemap.geometry.se2 import SE2
from edgemap.runtime.frames.errors import CameraError, OdometryError
from edgemap.runtime.frames.reading import one_line, user_path
from edgemap.runtime.frames.trajectory import Trajectory
from edgemap.runtime.inputs.cameras.imu_buffer import ImuBuffer
from edgemap.runtime.inputs.drives.sensor_csv import check_speed

FLOOR_FRAME = "base_footprint"  # REP-120: base_link may stand anywhere above the floor, this one stands on it
TF_MESSAGES = 200  # of each topic, looked through for the tree


def lens_of(info: Any, rectified: bool, name: str) -> Intrinsics | None:
    """The lens of a decoded `sensor_msgs/CameraInfo`; None where it is not calibrated. rectified: the pictures are
    (`image_rect`), so P holds and no distortion. Raises CameraError for a distortion that is not plumb_bob's.
    """
    k = info.p if rectified else info.k
    fx, cx, fy, cy = (k[0], k[2], k[5], k[6]) if rectified else (k[0], k[2], k[4], k[5])
    if not fx or not fy:
        return None
    coefficients = tuple(float(value) for value in info.d)
    if rectified or not any(coefficients):
        distortion = Distortion()
    elif info.distortion_model in ("plumb_bob", "rational_polynomial") and not any(coefficients[5:]):
        try:
            distortion = Distortion("brown_conrady", coefficients[:5])
        except GeometryError as error:
            raise CameraError(f"{name}: CameraInfo: {error}") from None
    else:
        raise CameraError(
            f"{name}: distortion {one_line(info.distortion_model, 40)} with {len(coefficients)} coefficients is not "
            "supported; pass --intrinsics or --camera-file"
        )
    try:
        return Intrinsics(info.width, info.height, float(fx), float(fy), float(cx), float(cy), distortion)
    except GeometryError as error:
        raise CameraError(f"{name}: CameraInfo: {error}") from None


def info_topics(pictures: str) -> list[str]:
    """Where the CameraInfo of a topic with pictures may be, by image_transport's convention: beside it, or one level
    up.
    """
    parts = pictures.split("/")
    return ["/".join([*parts[:-cut], "camera_info"]) for cut in (1, 2)]


def tf_of(recording: McapReading) -> TfTree:
    """The tf tree of a recording, by its first messages. Raises CameraError."""
    tree = TfTree(str(recording.path))
    for topic in (TF_STATIC, TF):
        if topic not in recording.topics:
            continue
        for number, (_, decode) in enumerate(recording.messages(topic)):
            tree.add(decode())
            if number >= TF_MESSAGES or tree.full:
                break
    return tree


def mount_of(tree: TfTree, frame_id: str) -> Mount | None:
    """The mount from tf: the pictures' frame above base_footprint; None where tf does not connect them.

    A tree that only has base_link gives none: its height above the floor is undefined. Raises CameraError.
    """
    found = tree.pose(FLOOR_FRAME, frame_id)
    return _mount(*found) if found else None


def _mount(rotation_base_optical: Any, place_m: Any) -> Mount | None:
    """Height, pitch, roll and lever arm of an optical frame; None for one that does not look forward.

    R = Ry(pitch) Rx(roll) B has the viewing direction (cos pitch, 0, -sin pitch) as its third column; its first is the
    picture's right, whose height is -cos(pitch) sin(roll). A camera turned sideways has no mount here.
    """
    ahead, right, down = rotation_base_optical[:, 2], rotation_base_optical[:, 0], rotation_base_optical[:, 1]
    if abs(ahead[1]) > math.sin(math.radians(2.0)) or ahead[0] <= 0:
        return None
    pitch_rad, roll_rad = math.asin(np.clip(-ahead[2], -1.0, 1.0)), math.atan2(-right[2], -down[2])
    try:
        return Mount(float(place_m[2]), pitch_rad, roll_rad, float(place_m[0]), float(place_m[1]))
    except GeometryError:
        return None


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
    found = recording.topics_of(IMU_KIND)
    if topic is not None and topic not in found:
        raise CameraError(f"{recording.path}: no {IMU_KIND} topic {topic} (there are: {', '.join(found) or 'none'})")
    for name in found if topic is None else [topic]:
        first = next(recording.messages(name), None)
        pose = tree.pose(optical, first[1]().header.frame_id) if first else None
        if pose is not None:
            return _read(recording, name, ImuBuffer(pose[0], kept=None))
    if topic is not None:
        raise CameraError(
            f"{recording.path}: tf does not join the frame of {one_line(topic)} to the pictures' ({one_line(optical)})"
        )
    return None


def push_message(buffer: ImuBuffer, message: Any, stamp_s: float) -> None:
    """Adds a decoded sensor_msgs/Imu to a buffer. A covariance that starts with -1 marks a missing value."""
    rate, force = message.angular_velocity, message.linear_acceleration
    if message.linear_acceleration_covariance[0] != -1.0:
        buffer.push_force(stamp_s, (force.x, force.y, force.z))
    if message.angular_velocity_covariance[0] != -1.0:
        buffer.push_rate(stamp_s, (rate.x, rate.y, rate.z))


def _read(recording: McapReading, topic: str, buffer: ImuBuffer) -> ImuSamples | None:
    for log_ns, decode in recording.messages(topic):
        message = decode()
        push_message(buffer, message, to_s(ns_of(message.header.stamp) or log_ns))
    samples = buffer.take(np.inf)
    return samples if len(samples) else None


def read_wheel(spec: str) -> Trajectory:
    """The wheels' own poses in `FILE.mcap[#/topic]`: what edgemap recorded, or else the first nav_msgs/Odometry topic.

    Poses of the base as the wheels integrate them, at the headers' stamps. Raises CameraError.
    """
    file, _, topic = spec.partition("#")
    recording = McapReading(user_path(file))
    try:
        if not topic and WHEEL_FILE in recording.attachments:
            return read_trajectory_file(recording.attachments[WHEEL_FILE], f"{file}: {WHEEL_FILE}")
        found = [name for name in recording.topics_of(WHEEL_KIND) if name not in (TRUTH, ODOMETRY)]
        if not found or (topic and topic not in found):
            there = ", ".join(found) or "none"
            raise CameraError(f"{file}: no {WHEEL_KIND} topic {topic or 'of wheels'} (there are: {there})")
        poses: dict[int, SE2] = {}
        for log_ns, decode in recording.messages(topic or found[0]):
            message = decode()
            stamp_ns = ns_of(message.header.stamp) or log_ns
            poses[stamp_ns] = planar_pose(message.pose.pose, f"{file}: {topic or found[0]} at {to_s(stamp_ns):.3f} s")
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
