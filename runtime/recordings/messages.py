"""Our frames, lenses, poses, boxes and objects as ROS 2 messages (dictionaries by field name).

Frames as in REP-103 and REP-105: map -> base_link (on the floor, at the turn axis) -> camera_optical_frame.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from edgemap.geometry.camera.intrinsics import Intrinsics
from edgemap.geometry.camera.mount import Mount
from edgemap.geometry.se2 import SE2
from edgemap.runtime.recordings.stamps import ros_time
from edgemap.runtime.slam import StepResult

MAP, BASE, OPTICAL = "map", "base_link", "camera_optical_frame"
Message = dict[str, Any]

NOT_MOVED = 1e-9  # variance of what a floor-bound robot does not do: z, roll, pitch


def header(stamp_ns: int, frame_id: str) -> Message:
    """`std_msgs/Header`."""
    return {"stamp": ros_time(stamp_ns), "frame_id": frame_id}


def compressed_image(stamp_ns: int, picture: bytes, encoding: str) -> Message:
    """`sensor_msgs/CompressedImage`. encoding: jpeg or png."""
    return {"header": header(stamp_ns, OPTICAL), "format": encoding, "data": picture}


def camera_info(stamp_ns: int, lens: Intrinsics) -> Message:
    """`sensor_msgs/CameraInfo`: K, P and plumb_bob's (k1, k2, p1, p2, k3).

    RealSense's variants of Brown-Conrady are called plumb_bob too, as Intel's ROS driver does; they differ from it by
    the product of radial and tangential terms.
    """
    fx, fy, cx, cy = map(float, (lens.fx, lens.fy, lens.cx, lens.cy))
    return {
        "header": header(stamp_ns, OPTICAL),
        "height": lens.height,
        "width": lens.width,
        "distortion_model": "plumb_bob",
        "d": [*lens.distortion.coefficients, 0.0, 0.0, 0.0, 0.0, 0.0][:5],
        "k": [fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0],
        "r": [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
        "p": [fx, 0.0, cx, 0.0, 0.0, fy, cy, 0.0, 0.0, 0.0, 1.0, 0.0],
    }


def mount_transform(stamp_ns: int, mount: Mount) -> Message:
    """`geometry_msgs/TransformStamped` base_link -> camera_optical_frame."""
    x, y, z, w = Rotation.from_matrix(mount.rotation_base_optical()).as_quat().tolist()
    return _transform(stamp_ns, BASE, OPTICAL, mount.position_base_m().tolist(), (x, y, z, w))


def pose_transform(stamp_ns: int, pose_map_base: SE2) -> Message:
    """`geometry_msgs/TransformStamped` map -> base_link."""
    place = [pose_map_base.x_m, pose_map_base.y_m, 0.0]
    return _transform(stamp_ns, MAP, BASE, place, _about_z(pose_map_base.yaw_rad))


def odometry(
    stamp_ns: int,
    pose_map_base: SE2,
    covariance: NDArray[np.float64] | None = None,
    velocity: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> Message:
    """`nav_msgs/Odometry` of base_link in map. covariance: (3, 3) of (x, y, yaw) in the map; velocity: of the base,
    forward and left in m/s, yaw in rad/s."""
    forward, left, turn = velocity
    return {
        "header": header(stamp_ns, MAP),
        "child_frame_id": BASE,
        "pose": {"pose": _pose(pose_map_base), "covariance": _covariance(covariance)},
        "twist": {
            "twist": {"linear": {"x": forward, "y": left, "z": 0.0}, "angular": {"x": 0.0, "y": 0.0, "z": turn}},
            "covariance": [0.0] * 36,
        },
    }


def detections_2d(stamp_ns: int, result: StepResult) -> Message:
    """`vision_msgs/Detection2DArray`: every box, px of the picture; id is the map object's where one stands there."""
    ids = {
        placed.sighting.detection: identity
        for placed, identity in zip(result.sightings, result.object_ids, strict=True)
    }
    found, head = [], header(stamp_ns, OPTICAL)
    detections = result.detections
    boxes = zip(detections.boxes.tolist(), detections.scores.tolist(), detections.labels, strict=True)
    for index, ((x0, y0, x1, y1), score, label) in enumerate(boxes):
        centre = {"position": {"x": (x0 + x1) / 2.0, "y": (y0 + y1) / 2.0}, "theta": 0.0}
        found.append(
            {
                "header": head,
                "results": [{"hypothesis": {"class_id": label, "score": score}}],
                "bbox": {"center": centre, "size_x": x1 - x0, "size_y": y1 - y0},
                "id": ids.get(index, ""),
            }
        )
    return {"header": head, "detections": found}


def tf(*transforms: Message) -> Message:
    """`tf2_msgs/TFMessage`."""
    return {"transforms": list(transforms)}


def _pose(pose: SE2) -> Message:
    x, y, z, w = _about_z(pose.yaw_rad)
    return {"position": {"x": pose.x_m, "y": pose.y_m, "z": 0.0}, "orientation": {"x": x, "y": y, "z": z, "w": w}}


def _about_z(yaw_rad: float) -> tuple[float, float, float, float]:
    return 0.0, 0.0, math.sin(yaw_rad / 2.0), math.cos(yaw_rad / 2.0)


def _covariance(planar: NDArray[np.float64] | None) -> list[float]:
    """ROS's 6x6 over (x, y, z, roll, pitch, yaw), row by row; all zero says unknown."""
    if planar is None:
        return [0.0] * 36
    full = np.eye(6) * NOT_MOVED
    full[np.ix_([0, 1, 5], [0, 1, 5])] = planar
    return full.ravel().tolist()


def _transform(
    stamp_ns: int, parent: str, child: str, place_m: list[float], rotation: tuple[float, float, float, float]
) -> Message:
    x, y, z = place_m
    qx, qy, qz, qw = rotation
    return {
        "header": header(stamp_ns, parent),
        "child_frame_id": child,
        "transform": {"translation": {"x": x, "y": y, "z": z}, "rotation": {"x": qx, "y": qy, "z": qz, "w": qw}},
    }
