"""Poses out of messages."""

import math
from typing import Any

from edgemap.geometry.se2 import SE2
from edgemap.runtime.errors import CameraError
from edgemap.runtime.trajectory import QUATERNION_TOLERANCE

FARTHEST_M = 1e6


def planar_pose(pose: Any, where: str) -> SE2:
    """A decoded `geometry_msgs/Pose`, seen from above. where: for messages. Raises CameraError for what is no pose."""
    return planar(pose.position, pose.orientation, where)


def planar(position: Any, orientation: Any, where: str) -> SE2:
    """A place and a quaternion, seen from above. Raises CameraError for what is no pose."""
    x, y, z, w = (getattr(orientation, axis) for axis in "xyzw")
    norm, values = math.hypot(x, y, z, w), (position.x, position.y)
    if not abs(norm - 1.0) < QUATERNION_TOLERANCE or not all(abs(value) <= FARTHEST_M for value in values):
        raise CameraError(f"{where}: no pose: position {values} m, quaternion of length {norm:.3f}")
    x, y, z, w = (value / norm for value in (x, y, z, w))
    return SE2(*values, math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z)))
