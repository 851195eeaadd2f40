"""Where the simulated camera is, and OpenGL's projection for exactly edgemap's camera model."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from edgemap.geometry.intrinsics import Intrinsics
from edgemap.geometry.mount import Mount
from edgemap.geometry.se2 import SE2
from edgemap.simulation.render.mesh import Array

NEAR_M, FAR_M = 0.05, 40.0


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """Where the camera is in the room: rotation (3, 3) from optical to room axes, position (3,) in metres."""

    rotation_home_optical: Array
    position_home_m: Array

    @classmethod
    def of_base(cls, pose_home_base: SE2, mount: Mount) -> View:
        """The view of a camera mounted on a base that stands in the room."""
        turn = np.eye(3)
        turn[:2, :2] = pose_home_base.rotation()
        position = turn @ mount.position_base_m() + [pose_home_base.x_m, pose_home_base.y_m, 0.0]
        return cls(turn @ mount.rotation_base_optical(), position)

    def to_optical(self, points_home_m: Array) -> Array:
        """Points of the room (N, 3) in the optical frame."""
        return (points_home_m - self.position_home_m) @ self.rotation_home_optical


def projection(intrinsics: Intrinsics) -> Array:
    """OpenGL's clip matrix (4, 4) for optical points (x right, y down, z forward); pixel centres are integers.

    Column u becomes 2 (u + 1/2) / width - 1, row v becomes 1 - 2 (v + 1/2) / height; w is the optical depth.
    """
    width, height = intrinsics.width, intrinsics.height
    matrix = np.zeros((4, 4))
    matrix[0, [0, 2]] = 2.0 * intrinsics.fx / width, 2.0 * (intrinsics.cx + 0.5) / width - 1.0
    matrix[1, [1, 2]] = -2.0 * intrinsics.fy / height, 1.0 - 2.0 * (intrinsics.cy + 0.5) / height
    matrix[2, 2:] = (FAR_M + NEAR_M) / (FAR_M - NEAR_M), -2.0 * FAR_M * NEAR_M / (FAR_M - NEAR_M)
    matrix[3, 2] = 1.0
    return matrix
