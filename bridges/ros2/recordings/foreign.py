"""Lens, mount, inertial samples and wheel odometry from the ROS 2 messages of a recording."""

import math
from contextlib import closing
from itertools import islice
from typing import Any

import numpy as np
from numpy.typing import NDArray

from edgemap.bridges.ros2.messages.tf_tree import TfTree, planar
from edgemap.bridges.ros2.messages.topics import ODOMETRY, TF, TF_STATIC, TRUTH
from edgemap.bridges.ros2.recordings.facts import WHEEL_FILE, read_trajectory_file
from edgemap.bridges.ros2.recordings.reader import open_reading
from edgemap.bridges.ros2.recordings.reading import Reading
from edgemap.geometry.camera.imu import ImuSamples
from edgemap.geometry.camera.intrinsics import Distortion, Intrinsics
from edgemap.geometry.camera.mount import BASE_OPTICAL, QUARTER_TURN, Mount
from edgemap.geometry.errors import GeometryError
from edgemap.geometry.se2 import SE2
from edgemap.runtime.frames.errors import CameraError
from edgemap.runtime.frames.faults import note_dropped
from edgemap.runtime.frames.reading import one_line, user_path
from edgemap.runtime.frames.trajectory import Trajectory
from edgemap.runtime.inputs.cameras.imu_buffer import ImuBuffer

FLOOR_FRAME = "base_footprint"  # REP-120: base_link may stand anywhere above the floor, this one stands on it
TF_MESSAGES = 200  # of each topic, looked through for the tree


TRANSPORTS = {"compressed", "compressedDepth", "theora", "ffmpeg", "foxglove", "zstd"}  # image_transport's last parts


def is_rectified(topic: str) -> bool:
    """Whether the last part of a topic with pictures calls them rectified: `image_rect`, `image_rect_color`."""
    parts = [part for part in topic.split("/") if part not in TRANSPORTS]
    return not {"rect", "rectified"}.isdisjoint(parts[-1].split("_"))


def lens_of(info: Any, topic: str, name: str, size: tuple[int, int] | None = None) -> Intrinsics | None:
    """The lens of a decoded `sensor_msgs/CameraInfo`; None where it is not calibrated. topic: of the pictures; of
    rectified ones P holds and no distortion. size: of the pictures, px: numbers for other ones are those of the sensor,
    of which binning and region of interest make them. Raises CameraError for a distortion that is not supported.
    """
    rectified = is_rectified(topic)
    k = info.p if rectified else info.k
    fx, cx, fy, cy = (k[0], k[2], k[5], k[6]) if rectified else (k[0], k[2], k[4], k[5])
    if not fx or not fy:
        return None
    wide, high, (x, y) = info.width, info.height, (0, 0)
    across, down = max(info.binning_x, 1), max(info.binning_y, 1)
    roi = info.roi
    part = (roi.width or wide, roi.height or high)
    if size not in (None, (wide, high)) and size == (part[0] // across, part[1] // down):
        x, y, (wide, high) = roi.x_offset, roi.y_offset, size
    else:
        across = down = 1
    try:
        distortion = Distortion() if rectified else Distortion.named(info.distortion_model, tuple(info.d))
        fx, fy, cx, cy = fx / across, fy / down, (cx - x + 0.5) / across - 0.5, (cy - y + 0.5) / down - 0.5
        return Intrinsics(wide, high, float(fx), float(fy), float(cx), float(cy), distortion)
    except GeometryError as error:
        raise CameraError(f"{name}: CameraInfo: {error}; pass --intrinsics or --camera-file") from None


def info_topics(pictures: str) -> list[str]:
    """Where the CameraInfo of a topic with pictures may be, by image_transport's convention: beside it, or one level
    up.
    """
    parts = pictures.split("/")
    return ["/".join([*parts[:-cut], "camera_info"]) for cut in (1, 2)]


def tf_of(recording: Reading) -> TfTree:
    """The tf tree of a recording, by its first messages. Raises CameraError."""
    tree = TfTree(str(recording.path))
    for topic in (TF_STATIC, TF):
        if topic in recording.topics:
            for _, message in islice(recording.messages(topic), TF_MESSAGES):
                tree.add(message)
    return tree


def mount_of(tree: TfTree, frame_id: str, rotate: int = 0) -> tuple[Mount | None, str]:
    """The mount from tf, the pictures' frame above base_footprint, and what is to be said about it: where tf does not
    connect them, where the frame's axes are not optical ones, where the camera looks aside or lies on its side.
    rotate: degrees by which pictures are turned clockwise until they are upright.

    A tree that only has base_link gives none: its height above the floor is undefined. Raises CameraError.
    """
    found = tree.pose(FLOOR_FRAME, frame_id)
    if found is None:
        return None, f"tf does not join {FLOOR_FRAME} to {one_line(frame_id) or 'the pictures (no frame_id)'}: no mount"
    rotation, place_m, text = found[:3, :3], found[:3, 3], ""
    if rotation[2, 2] > math.cos(math.pi / 4.0):  # z points up: axes of a body, x ahead
        rotation, text = rotation @ BASE_OPTICAL, f"{one_line(frame_id)} has the axes of a body in tf, x ahead"
        text += ": taken as an optical frame by REP 103"
    turns = round(math.atan2(-rotation[2, 0], -rotation[2, 1]) / (math.pi / 2.0)) % 4  # roll in quarter turns
    if 90 * turns != rotate and turns:
        return None, f"tf has the camera turned by {90 * turns} deg about its axis: --rotate {90 * turns}; no mount"
    rotation = rotation @ np.linalg.matrix_power(QUARTER_TURN, rotate // 90).T
    mount = _mount(rotation, place_m)
    if mount is None:
        x, y, z = rotation[:, 2]
        aside_deg, down_deg = math.degrees(math.atan2(y, x)), math.degrees(math.asin(np.clip(-z, -1.0, 1.0)))
        text = (
            f"tf puts the camera {place_m[2]:.2f} m up, looking {down_deg:.1f} deg down and {aside_deg:.1f} deg to the "
            f"left: no mount, which looks ahead; --mount {max(place_m[2], 0.0):.2f},{down_deg:.1f} makes that ahead"
        )
    return mount, text


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


def imu_of(recording: Reading, tree: TfTree, optical: str, topic: str | None = None) -> tuple[str, ImuSamples | None]:
    """The first sensor_msgs/Imu topic of a bag, or the named one, whose frame tf connects to the pictures', and its
    samples.

    None where there is none. optical: the pictures' frame. Raises CameraError, also for a named topic that cannot be
    used.
    """
    found = recording.topics_of(IMU_KIND)
    if topic is not None and topic not in found:
        raise CameraError(f"{recording.path}: no {IMU_KIND} topic {topic} (there are: {', '.join(found) or 'none'})")
    for name in found if topic is None else [topic]:
        pose = tree.pose(optical, recording.first(name).header.frame_id)
        if pose is not None:
            return name, read_imu(recording, name, pose[:3, :3])
    if topic is not None:
        raise CameraError(
            f"{recording.path}: tf does not join the frame of {one_line(topic)} to the pictures' ({one_line(optical)})"
        )
    return "", None


def push_message(buffer: ImuBuffer, message: Any, stamp_s: float) -> None:
    """Adds a decoded sensor_msgs/Imu to a buffer. A covariance that starts with -1 marks a missing value."""
    rate, force = message.angular_velocity, message.linear_acceleration
    if message.linear_acceleration_covariance[0] != -1.0:
        buffer.push_force(stamp_s, (force.x, force.y, force.z))
    if message.angular_velocity_covariance[0] != -1.0:
        buffer.push_rate(stamp_s, (rate.x, rate.y, rate.z))


def read_imu(recording: Reading, topic: str, rotation: NDArray[np.float64] | None = None) -> ImuSamples | None:
    """The samples of a topic in the optical frame; None where there are none. rotation: (3, 3), from the IMU's frame,
    None where it is the optical one, as edgemap records it. Raises CameraError."""
    buffer, dropped = ImuBuffer(rotation, kept=None), list[str]()
    for stamp_s, message in recording.sound(topic, dropped):
        push_message(buffer, message, stamp_s)
    samples = buffer.take(np.inf)
    note_dropped(f"{recording.path}: {topic}", dropped + buffer.dropped, recording.topics[topic].count)
    return samples if len(samples) else None


def read_wheel(spec: str) -> Trajectory:
    """The wheels' own poses in `FILE.mcap[#/topic]`: what edgemap recorded, or else the first nav_msgs/Odometry topic.

    Poses of the base as the wheels integrate them, at the headers' stamps. Raises CameraError.
    """
    file, _, topic = spec.partition("#")
    with closing(open_reading(user_path(file))) as recording:
        return wheels_of(recording, topic)


def wheels_of(recording: Reading, topic: str = "") -> Trajectory:
    """As of `read_wheel`. topic: empty for what edgemap recorded, or else the first one. Raises CameraError."""
    file = recording.path
    if not topic and WHEEL_FILE in recording.attachments:
        return read_trajectory_file(recording.attachments[WHEEL_FILE], f"{file}: {WHEEL_FILE}")
    found = [name for name in recording.topics_of(WHEEL_KIND) if name not in (TRUTH, ODOMETRY)]
    if not found or (topic and topic not in found):
        there = ", ".join(found) or "none"
        raise CameraError(f"{file}: no {WHEEL_KIND} topic {topic or 'of wheels'} (there are: {there})")
    topic = topic or found[0]
    where, dropped, poses = f"{file}: {topic}", list[str](), dict[float, SE2]()
    for stamp_s, message in recording.sound(topic, dropped):
        pose = message.pose.pose
        try:
            poses[stamp_s] = planar(pose.position, pose.orientation, f"at {stamp_s:.3f} s")
        except CameraError as error:
            dropped.append(str(error))
    if not poses:
        raise CameraError(f"{where} has no pose" + (f" ({dropped[0]})" if dropped else ""))
    note_dropped(where, dropped, recording.topics[topic].count)
    return Trajectory(np.array(list(poses)), tuple(poses.values()))
