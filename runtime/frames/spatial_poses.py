"""3-D poses of a camera or a base: as planar ones of the base (REP-103), and as the camera's attitude."""

from typing import Literal

import numpy as np
from scipy.spatial.transform import Rotation

from edgemap.geometry.arrays import Array
from edgemap.geometry.camera.mount import Mount
from edgemap.geometry.se2 import SE2
from edgemap.runtime.frames.errors import CameraError
from edgemap.runtime.frames.trajectory import AttitudeTrack

LEVEL = 1e-4  # rad and m; files round


def poses_of(positions_m: Array, quaternions: Array) -> Array:
    """Poses (N, 4, 4) from positions (N, 3) and unit quaternions (N, 4) in the order x, y, z, w."""
    poses = np.tile(np.eye(4), (len(quaternions), 1, 1))
    poses[:, :3, :3] = Rotation.from_quat(quaternions).as_matrix()
    poses[:, :3, 3] = positions_m
    return poses


def pose_of(rotation: Array, position_m: Array) -> Array:
    """A pose (4, 4) from a rotation (3, 3) and a position (3,)."""
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation, position_m
    return pose


def up_vector(world_up: str | Array) -> Array:
    """The unit vector, (3,), of an axis name such as `z` or `-y`; a vector is returned as it is."""
    if not isinstance(world_up, str):
        return world_up
    vector = np.zeros(3)
    vector["xyz".index(world_up[-1])] = -1.0 if world_up.startswith("-") else 1.0
    return vector


def planarise(
    poses: Array, world_up: str | Array, ahead: Literal["x", "z"], mount: Mount | None = None
) -> tuple[SE2, ...]:
    """Poses to the world, (N, 4, 4), metres, as `pose_start_base`: base poses relative to the first one.

    ahead: axis that points ahead, x of a base (REP-103), z of a lens (optical: x right, y down, z forward); its
    horizontal part is the heading. mount: of that lens, whose lever arm takes it to the turn axis (none without a
    mount). Raises CameraError where the axis points straight up or down.
    """
    up = up_vector(world_up)
    headings = poses[:, :3, "xyz".index(ahead)]
    headings = headings - np.outer(headings @ up, up)
    lengths = np.linalg.norm(headings, axis=1)
    if lengths.min() < 1e-3:
        raise CameraError(
            f"pose {int(lengths.argmin())} looks straight along world_up {world_up!r}: it has no heading; "
            "is world_up in camera.yaml the axis that points up?"
        )
    headings /= lengths[:, None]
    first = headings[0]
    left = np.cross(up, first)
    travelled = poses[:, :3, 3] - poses[0, :3, 3]
    yaws = np.arctan2(headings @ left, headings @ first)
    lever = SE2(mount.forward_m, mount.left_m, 0.0) if mount else SE2()
    planar = zip(travelled @ first, travelled @ left, yaws, strict=True)
    return tuple(lever @ SE2(*pose) @ lever.inverse() for pose in planar)


def upright_camera(poses_world_camera: Array, world_up: str, mount: Mount | None) -> Array:
    """Camera-to-world poses as (N, 4, 4) of the lens, base axes, in a z-up frame that starts where the first one is
    and heads where it looks: all six dimensions, levelled by the mount's angles alone."""
    up = up_vector(world_up)
    headings = poses_world_camera[:, :3, 2]
    ahead = headings[0] - (headings[0] @ up) * up
    ahead /= np.linalg.norm(ahead)
    start_world = np.array([ahead, np.cross(up, ahead), up])
    optical_base = (mount or Mount(1.0)).rotation_base_optical().T
    poses = np.tile(np.eye(4), (len(poses_world_camera), 1, 1))
    poses[:, :3, :3] = start_world @ poses_world_camera[:, :3, :3] @ optical_base
    poses[:, :3, 3] = (poses_world_camera[:, :3, 3] - poses_world_camera[0, :3, 3]) @ start_world.T
    return poses


def attitudes_of(
    stamps_s: Array, poses: Array, world_up: str | Array, mount: Mount | None = None
) -> AttitudeTrack | None:
    """Roll, pitch and rise of the lens from poses to the world, (N, 4, 4). mount: of the lens on the base where they
    are the base's, in base axes; without one they are the camera's, optical. None where a base stays level and at one
    height."""
    up = up_vector(world_up)
    directions = np.einsum("nij,i->nj", poses[:, :3, :3], up)
    heights = poses[:, :3, 3] @ up
    if mount is not None:
        heights = heights + directions @ mount.position_base_m()
        if np.abs(directions[:, :2]).max() < LEVEL and np.ptp(heights) < LEVEL:
            return None
        directions = directions @ mount.rotation_base_optical()
    right, down, forward = directions.T
    roll, pitch = np.arctan2(-right, -down), np.arctan2(-forward, np.hypot(right, down))
    return AttitudeTrack(stamps_s, np.unwrap(roll), np.unwrap(pitch), heights - heights[0])
