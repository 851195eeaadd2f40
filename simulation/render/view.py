"""Pose of the simulated camera, and OpenGL's projection for exactly edgemap's camera model."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from edgemap.geometry.camera.intrinsics import Intrinsics
from edgemap.geometry.camera.mount import Mount
from edgemap.geometry.se2 import SE2
from edgemap.simulation.render.mesh import Array

NEAR_M, FAR_M = 0.05, 40.0


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """Pose of the camera in the room: rotation (3, 3) from optical to room axes, position (3,) in metres."""

    rotation_home_optical: Array
    position_home_m: Array

    @classmethod
    def of_base(cls, pose_home_base: SE2, mount: Mount, lean: Array | None = None, rise_m: float = 0.0) -> "View":
        """The view of a camera mounted on a base that stands in the room. lean: (3, 3), from the tilted base's axes to
        the level one's; rise_m: of the base above the floor."""
        turn = np.eye(3)
        turn[:2, :2] = pose_home_base.rotation()
        turn = turn if lean is None else turn @ lean
        position = turn @ mount.position_base_m() + [pose_home_base.x_m, pose_home_base.y_m, rise_m]
        return cls(turn @ mount.rotation_base_optical(), position)

    def to_optical(self, points_home_m: Array) -> Array:
        """Points of the room (N, 3) in the optical frame."""
        return (points_home_m - self.position_home_m) @ self.rotation_home_optical


def projection(intrinsics: Intrinsics) -> Array:
    """OpenGL's clip matrix (4, 4) for optical points (x right, y down, z forward); pixel centres are integers.

    Column u becomes 2 (u + 1/2) / width - 1, row v becomes 2 (v + 1/2) / height - 1; w is the optical depth. OpenGL's
    lowest row is thus the picture's top row, and pixels that are read back need no flip.
    """
    width, height = intrinsics.width, intrinsics.height
    matrix = np.zeros((4, 4))
    matrix[0, [0, 2]] = 2.0 * intrinsics.fx / width, 2.0 * (intrinsics.cx + 0.5) / width - 1.0
    matrix[1, [1, 2]] = 2.0 * intrinsics.fy / height, 2.0 * (intrinsics.cy + 0.5) / height - 1.0
    matrix[2, 2:] = (FAR_M + NEAR_M) / (FAR_M - NEAR_M), -2.0 * FAR_M * NEAR_M / (FAR_M - NEAR_M)
    matrix[3, 2] = 1.0
    return matrix


def metres(depth: NDArray[np.float32]) -> NDArray[np.float32]:
    """Optical depth from a depth buffer's 0..1, as `projection` fills it; FAR_M where nothing was drawn."""
    return np.float32(2.0 * FAR_M * NEAR_M) / (
        np.float32(FAR_M + NEAR_M) - (np.float32(2.0) * depth - np.float32(1.0)) * np.float32(FAR_M - NEAR_M)
    )


def oversampled(intrinsics: Intrinsics, times: int) -> Intrinsics:
    """A pinhole with `times` as many columns and rows whose pixel (n u, n v) looks where (u, v) looked."""
    return replace(
        intrinsics,
        width=times * intrinsics.width,
        height=times * intrinsics.height,
        fx=times * intrinsics.fx,
        fy=times * intrinsics.fy,
        cx=times * intrinsics.cx,
        cy=times * intrinsics.cy,
    )


def clip_matrix(view: View, intrinsics: Intrinsics) -> Array:
    """(4, 4) from homogeneous points of the home to OpenGL's clip space."""
    optical_home = np.eye(4)
    optical_home[:3, :3] = view.rotation_home_optical.T
    optical_home[:3, 3] = -view.rotation_home_optical.T @ view.position_home_m
    return projection(intrinsics) @ optical_home
