"""Our frames, lenses, poses, boxes and objects as ROS 2 messages (dictionaries by field name).

Frames as in REP-103 and REP-105: map -> odom (moves when a loop closes) -> base_link (continuous; on the floor, at the
turn axis) -> camera_optical_frame.
"""

import math

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from edgemap.bridges.ros2.messages.definitions import Message, ros_time
from edgemap.bridges.ros2.messages.topics import IDS, FrameIds
from edgemap.geometry.camera.intrinsics import Intrinsics
from edgemap.geometry.camera.mount import Mount
from edgemap.geometry.objects.annotations import MapIdentity
from edgemap.geometry.se2 import SE2
from edgemap.runtime.step.slam import StepResult


def header(stamp_ns: int, frame_id: str) -> Message:
    """`std_msgs/Header`."""
    return {"stamp": ros_time(stamp_ns), "frame_id": frame_id}


def compressed_image(stamp_ns: int, picture: bytes, encoding: str, ids: FrameIds = IDS) -> Message:
    """`sensor_msgs/CompressedImage`. encoding: jpeg or png."""
    return {"header": header(stamp_ns, ids.optical), "format": encoding, "data": picture}


def camera_info(stamp_ns: int, lens: Intrinsics, ids: FrameIds = IDS) -> Message:
    """`sensor_msgs/CameraInfo`: K, P and D of `plumb_bob`, `rational_polynomial` or `equidistant`.

    RealSense's variants of Brown-Conrady are called plumb_bob too, as Intel's ROS driver does; they differ from it by
    the product of radial and tangential terms.
    """
    others = {"rational": ("rational_polynomial", 8), "equidistant": ("equidistant", 4)}
    model, count = others.get(lens.distortion.model, ("plumb_bob", 5))
    fx, fy, cx, cy = map(float, (lens.fx, lens.fy, lens.cx, lens.cy))
    return {
        "header": header(stamp_ns, ids.optical),
        "height": lens.height,
        "width": lens.width,
        "distortion_model": model,
        "d": [*lens.distortion.coefficients, *[0.0] * count][:count],
        "k": [fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0],
        "r": [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
        "p": [fx, 0.0, cx, 0.0, 0.0, fy, cy, 0.0, 0.0, 0.0, 1.0, 0.0],
    }


def imu(stamp_ns: int, gyro_rad_s: list[float], accel_m_s2: list[float]) -> Message:
    """`sensor_msgs/Imu` in the optical frame. The orientation is unknown: its covariance starts with -1."""
    gyro, accel = (dict(zip("xyz", values, strict=True)) for values in (gyro_rad_s, accel_m_s2))
    return {
        "header": header(stamp_ns, IDS.optical),
        "orientation_covariance": [-1.0] + [0.0] * 8,
        "angular_velocity": gyro,
        "linear_acceleration": accel,
    }


def mount_transform(stamp_ns: int, mount: Mount, ids: FrameIds = IDS) -> Message:
    """`geometry_msgs/TransformStamped` base_link -> camera_optical_frame."""
    turned = Rotation.from_matrix(mount.rotation_base_optical()).as_quat().tolist()
    place_m = mount.position_base_m().tolist()
    return _transform(stamp_ns, ids.base, ids.optical, place_m, dict(zip("xyzw", turned, strict=True)))


def planar_transform(stamp_ns: int, parent: str, child: str, pose_parent_child: SE2) -> Message:
    """`geometry_msgs/TransformStamped` on the floor."""
    place = [pose_parent_child.x_m, pose_parent_child.y_m, 0.0]
    return _transform(stamp_ns, parent, child, place, orientation(pose_parent_child.yaw_rad))


def pose(stamp_ns: int, result: StepResult, ids: FrameIds = IDS) -> Message:
    """`geometry_msgs/PoseWithCovarianceStamped` of the base in map."""
    place = {"pose": _pose(result.pose_map_base), "covariance": _covariance(result.pose_covariance)}
    return {"header": header(stamp_ns, ids.map), "pose": place}


def goal_pose(pose_map_base: SE2, frame_id: str, stamp_ns: int) -> Message:
    """`geometry_msgs/PoseStamped` of where the base is to go."""
    return {"header": header(stamp_ns, frame_id), "pose": _pose(pose_map_base)}


def step_odometry(stamp_ns: int, result: StepResult, dt_s: float, ids: FrameIds = IDS) -> Message:
    """`nav_msgs/Odometry` of the base in odom, after one step. dt_s: since the step before; 0 for the first one, which
    has no velocity."""
    message = odometry(stamp_ns, result.pose_odom_base, result.odom_covariance, ids)
    if dt_s > 0:
        moved = result.motion.motion
        message["twist"] = {
            "twist": {
                "linear": {"x": moved.x_m / dt_s, "y": moved.y_m / dt_s},
                "angular": {"z": moved.yaw_rad / dt_s},
            },
            "covariance": _covariance(result.motion.covariance / dt_s**2),
        }
    return message


def odometry(
    stamp_ns: int, pose_odom_base: SE2, covariance: NDArray[np.float64] | None = None, ids: FrameIds = IDS
) -> Message:
    """`nav_msgs/Odometry` of the base in odom, at rest. covariance: (3, 3) of (x, y, yaw) in odom."""
    return {
        "header": header(stamp_ns, ids.odom),
        "child_frame_id": ids.base,
        "pose": {"pose": _pose(pose_odom_base), "covariance": _covariance(covariance)},
    }


def instance_id(object_id: str, identity: MapIdentity | None) -> str:
    """An object's id among those of all maps: MAP_ID/OBJECT_ID; of a list that is no map, the object's own."""
    return f"{identity.map_id}/{object_id}" if identity and object_id else object_id


def detections_2d(stamp_ns: int, result: StepResult, ids: FrameIds = IDS) -> Message:
    """`vision_msgs/Detection2DArray`: every box, px, with the id of its map object if it has one."""
    objects = result.object_of_box
    entries, head = [], header(stamp_ns, ids.optical)
    detections = result.detections
    boxes = zip(detections.boxes.tolist(), detections.scores.tolist(), detections.labels, strict=True)
    for index, ((x0, y0, x1, y1), score, label) in enumerate(boxes):
        centre = {"position": {"x": (x0 + x1) / 2.0, "y": (y0 + y1) / 2.0}, "theta": 0.0}
        entries.append(
            {
                "header": head,
                "results": [{"hypothesis": {"class_id": label, "score": score}}],
                "bbox": {"center": centre, "size_x": x1 - x0, "size_y": y1 - y0},
                "id": instance_id(objects.get(index, ""), result.annotations.identity),
            }
        )
    return {"header": head, "detections": entries}


def tf(*transforms: Message) -> Message:
    """`tf2_msgs/TFMessage`."""
    return {"transforms": list(transforms)}


def _pose(pose: SE2) -> Message:
    return {"position": {"x": pose.x_m, "y": pose.y_m, "z": 0.0}, "orientation": orientation(pose.yaw_rad)}


def orientation(yaw_rad: float) -> Message:
    """`geometry_msgs/Quaternion` about z."""
    return {"x": 0.0, "y": 0.0, "z": math.sin(yaw_rad / 2.0), "w": math.cos(yaw_rad / 2.0)}


def _covariance(planar: NDArray[np.float64] | None) -> list[float]:
    """ROS's 6x6 over (x, y, z, roll, pitch, yaw), row by row; all zeros mean unknown."""
    if planar is None:
        return [0.0] * 36
    full = 1e-9 * np.eye(6)  # a robot on the floor does not move in z, roll and pitch
    full[np.ix_([0, 1, 5], [0, 1, 5])] = planar
    return full.ravel().tolist()


def _transform(stamp_ns: int, parent: str, child: str, place_m: list[float], rotation: Message) -> Message:
    return {
        "header": header(stamp_ns, parent),
        "child_frame_id": child,
        "transform": {"translation": dict(zip("xyz", place_m, strict=True)), "rotation": rotation},
    }
