"""A tf tree, as messages bring it, and what it says of two frames."""

import math
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from edgemap.geometry.arrays import Array
from edgemap.runtime.errors import CameraError
from edgemap.runtime.trajectory import QUATERNION_TOLERANCE

FARTHEST_M = 1000.0
FRAMES = 10_000  # a tree with more is none


class TfTree:
    """The first transform that comes for each frame. where: for messages."""

    def __init__(self, where: str) -> None:
        self._where = where
        self._parents: dict[str, tuple[str, Any]] = {}

    def add(self, message: Any) -> None:
        """Take in a decoded `tf2_msgs/TFMessage`."""
        for step in message.transforms:
            if len(self._parents) < FRAMES:
                child, parent = step.child_frame_id.lstrip("/"), step.header.frame_id.lstrip("/")
                self._parents.setdefault(child, (parent, step.transform))

    @property
    def full(self) -> bool:
        """Whether no further frame is taken in."""
        return len(self._parents) >= FRAMES

    def pose(self, parent: str, child: str) -> tuple[Array, Array] | None:
        """Rotation (3, 3) and position (3,) of a frame in another one; None where the tree does not join them.

        Raises CameraError for a transform on the way that is none.
        """
        ups, downs = self._to_root(child.lstrip("/")), self._to_root(parent.lstrip("/"))
        for frame, (rotation, place_m) in ups.items():
            if frame in downs:
                back, origin_m = downs[frame]
                return back.T @ rotation, back.T @ (place_m - origin_m)
        return None

    def _to_root(self, frame: str) -> dict[str, tuple[Array, Array]]:
        """The frame's pose in itself and in each frame above it, nearest first."""
        found = {frame: (np.eye(3), np.zeros(3))}
        while frame in self._parents and self._parents[frame][0] not in found:
            rotation, place_m = found[frame]
            frame, step = self._parents[frame]
            step_rotation, step_m = self._checked(frame, step)
            found[frame] = step_rotation @ rotation, step_rotation @ place_m + step_m
        return found

    def _checked(self, frame: str, step: Any) -> tuple[Array, Array]:
        quaternion = [step.rotation.x, step.rotation.y, step.rotation.z, step.rotation.w]
        moved_m = [step.translation.x, step.translation.y, step.translation.z]
        if not abs(math.hypot(*quaternion) - 1.0) < QUATERNION_TOLERANCE or not max(map(abs, moved_m)) < FARTHEST_M:
            raise CameraError(
                f"{self._where}: tf to {frame}: translation {moved_m} m, quaternion {quaternion}: no transform"
            )
        return Rotation.from_quat(quaternion).as_matrix(), np.array(moved_m)
