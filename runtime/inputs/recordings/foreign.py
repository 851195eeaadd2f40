"""Intrinsics and mount from the ROS 2 messages of other programs."""

import math
from typing import Any

import numpy as np

from edgemap.geometry.camera.intrinsics import Distortion, Intrinsics
from edgemap.geometry.camera.mount import Mount
from edgemap.geometry.errors import GeometryError
from edgemap.runtime.frames.errors import CameraError
from edgemap.runtime.frames.messages.tf_tree import TfTree
from edgemap.runtime.frames.messages.topics import TF, TF_STATIC
from edgemap.runtime.frames.reading import one_line
from edgemap.runtime.inputs.recordings.reader import McapReading

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
