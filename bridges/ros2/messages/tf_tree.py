"""A tf tree built from messages: the transform between two frames, and planar poses."""

import math
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from edgemap.geometry.arrays import Array
from edgemap.geometry.se2 import SE2
from edgemap.runtime.frames.errors import CameraError
from edgemap.runtime.frames.reading import one_line
from edgemap.runtime.frames.spatial_poses import pose_of
from edgemap.runtime.frames.trajectory import QUATERNION_TOLERANCE

FARTHEST_M, FARTHEST_POSE_M = 1000.0, 1e6  # of two frames of one robot; of a pose in the world


class TfTree:
    """The first transform that comes for each frame. where: for messages."""

    def __init__(self, where: str) -> None:
        self._where = where
        self._parents: dict[str, tuple[str, Any]] = {}

    def add(self, message: Any) -> None:
        """Adds a decoded `tf2_msgs/TFMessage`."""
        for step in message.transforms:
            child, parent = step.child_frame_id.lstrip("/"), step.header.frame_id.lstrip("/")
            self._parents.setdefault(child, (parent, step.transform))

    def pose(self, parent: str, child: str) -> Array | None:
        """Pose (4, 4) of a frame in another one; None where the tree does not connect them. Raises CameraError for an
        invalid transform between them.
        """
        ups, downs = self._to_root(child.lstrip("/")), self._to_root(parent.lstrip("/"))
        return next((np.linalg.inv(downs[frame]) @ pose for frame, pose in ups.items() if frame in downs), None)

    def _to_root(self, frame: str) -> dict[str, Array]:
        """The frame's pose in itself and in each frame above it, nearest first."""
        ancestors = {frame: np.eye(4)}
        while frame in self._parents and self._parents[frame][0] not in ancestors:
            pose = ancestors[frame]
            frame, step = self._parents[frame]
            ancestors[frame] = transform_of(step, f"{self._where}: tf to {one_line(frame, 60)}") @ pose
        return ancestors


def transform_of(transform: Any, where: str) -> Array:
    """A decoded `geometry_msgs/Transform` as a pose (4, 4). Raises CameraError for none."""
    rotation, translation = transform.rotation, transform.translation
    quaternion = [rotation.x, rotation.y, rotation.z, rotation.w]
    moved_m = [translation.x, translation.y, translation.z]
    if not abs(math.hypot(*quaternion) - 1.0) < QUATERNION_TOLERANCE or not max(map(abs, moved_m)) < FARTHEST_M:
        raise CameraError(f"{where}: translation {moved_m} m, quaternion {quaternion}: no transform")
    return pose_of(Rotation.from_quat(quaternion).as_matrix(), np.array(moved_m))


def planar(position: Any, orientation: Any, where: str) -> SE2:
    """A position and a quaternion as a planar pose. Raises CameraError for an invalid pose."""
    x, y, z, w = (getattr(orientation, axis) for axis in "xyzw")
    norm, values = math.hypot(x, y, z, w), (position.x, position.y)
    if not abs(norm - 1.0) < QUATERNION_TOLERANCE or not all(abs(value) <= FARTHEST_POSE_M for value in values):
        raise CameraError(f"{where}: no pose: position {values} m, quaternion of length {norm:.3f}")
    x, y, z, w = (value / norm for value in (x, y, z, w))
    return SE2(*values, math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z)))
