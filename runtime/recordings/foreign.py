"""Lens and mount out of the ROS 2 messages of a recording that somebody else made."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from edgemap.geometry.camera.intrinsics import Distortion, Intrinsics
from edgemap.geometry.camera.mount import Mount
from edgemap.geometry.errors import GeometryError
from edgemap.runtime.errors import CameraError
from edgemap.runtime.reading import one_line
from edgemap.runtime.recordings.reader import McapReading
from edgemap.runtime.trajectory import QUATERNION_TOLERANCE

FLOOR_FRAME = "base_footprint"  # REP-120: base_link may stand anywhere above the floor, this one stands on it
FARTHEST_M = 1000.0
TF_MESSAGES, TF_FRAMES = 200, 10_000  # looked through for the mount


def lens_of(info: Any, rectified: bool, name: str) -> Intrinsics | None:
    """The lens of a decoded `sensor_msgs/CameraInfo`; None where it says that it is not calibrated.

    rectified: the pictures are (`image_rect`), so P holds and no distortion. Raises CameraError for a distortion that
    is not plumb_bob's.
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


def mount_of(recording: McapReading, frame_id: str) -> Mount | None:
    """Where tf puts the pictures' frame above base_footprint; None where tf does not say so.

    A tree that only has base_link gives none: how high that is above the floor stands nowhere.
    """
    parents: dict[str, tuple[str, Any]] = {}
    for topic in ("/tf_static", "/tf"):
        if topic not in recording.topics:
            continue
        for number, (_, decode) in enumerate(recording.messages(topic)):
            for transform in decode().transforms:
                child, parent = transform.child_frame_id.lstrip("/"), transform.header.frame_id.lstrip("/")
                parents.setdefault(child, (parent, transform.transform))
            if number >= TF_MESSAGES or len(parents) >= TF_FRAMES:
                break
    rotation, place = np.eye(3), np.zeros(3)
    frame = frame_id.lstrip("/")
    for _ in range(len(parents) + 1):
        if frame == FLOOR_FRAME:
            return _mount(rotation, place)
        if frame not in parents:
            return None
        frame, step = parents[frame]
        quaternion = [step.rotation.x, step.rotation.y, step.rotation.z, step.rotation.w]
        translation_m = [step.translation.x, step.translation.y, step.translation.z]
        if (
            not abs(math.hypot(*quaternion) - 1.0) < QUATERNION_TOLERANCE
            or not max(map(abs, translation_m)) < FARTHEST_M
        ):
            raise CameraError(
                f"{recording.path}: tf to {frame}: translation {translation_m} m, quaternion {quaternion}: no transform"
            )
        turn = Rotation.from_quat(quaternion).as_matrix()
        place = turn @ place + translation_m
        rotation = turn @ rotation
    return None


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
