"""Text files of 3-D poses and of stamps, checked line by line; and those poses as planar ones of the base (REP-103)."""

from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from edgemap.geometry.arrays import Array
from edgemap.geometry.camera.mount import Mount
from edgemap.geometry.se2 import SE2
from edgemap.runtime.frames.errors import CameraError, OdometryError
from edgemap.runtime.frames.reading import read_bytes
from edgemap.runtime.frames.tables import STAMP, Column, NumberTable
from edgemap.runtime.frames.trajectory import AttitudeTrack, Trajectory, tum_rows
from edgemap.runtime.inputs.drives.pictures import list_pictures

MATRICES = {
    count: NumberTable(tuple(Column("xyzw"[i // 4] + "xyzt"[i % 4]) for i in range(count))) for count in (12, 16)
}
STAMPS = NumberTable((STAMP,))
OPTICAL_FORWARD = (0.0, 0.0, 1.0)
BASE_FORWARD = (1.0, 0.0, 0.0)
LEVEL = 1e-4  # rad and m; files round


def read_matrices(path: Path, columns: int) -> Array:
    """Poses (N, 4, 4) from lines of 12 numbers (3x4, KITTI) or 16 (4x4), row-major, metres.

    Raises CameraError with the line number for a line of other length, NaN, or a matrix that is not a rigid motion.
    """
    _, rows = MATRICES[columns].read(path, CameraError)
    poses = np.tile(np.eye(4), (len(rows), 1, 1))
    poses.reshape(len(rows), 16)[:, :columns] = rows
    rotations = poses[:, :3, :3]
    errors = np.abs(rotations @ rotations.transpose(0, 2, 1) - np.eye(3)).max(axis=(1, 2))
    with np.errstate(all="ignore"):  # numpy warns of determinants of huge numbers
        errors = np.maximum(errors, np.abs(np.linalg.det(rotations) - 1.0))
    errors = np.maximum(errors, np.abs(poses[:, 3] - [0.0, 0.0, 0.0, 1.0]).max(axis=1))
    if errors.max() > 0.05:
        worst = int(errors.argmax())
        raise CameraError(f"{path}: pose {worst} is no rigid motion (it is off by {errors[worst]:.3g})")
    return poses


def read_tum_3d(path: Path) -> tuple[Array, Array]:
    """Stamps (N,) in seconds and poses (N, 4, 4) from a TUM file, `stamp x y z qx qy qz qw` per line.

    Raises CameraError with the line number for a line that is not eight finite numbers with a unit quaternion.
    """
    rows = tum_rows(read_bytes(path, CameraError), str(path), CameraError)
    return rows[:, 0], poses_of(rows[:, 1:4], rows[:, 4:])


def poses_of(positions_m: Array, quaternions: Array) -> Array:
    """Poses (N, 4, 4) from positions (N, 3) and unit quaternions (N, 4) in the order x, y, z, w."""
    poses = np.tile(np.eye(4), (len(quaternions), 1, 1))
    poses[:, :3, :3] = Rotation.from_quat(quaternions).as_matrix()
    poses[:, :3, 3] = positions_m
    return poses


def quaternion_of(rotation: Array) -> Array:
    """The unit quaternion (4,) in the order x, y, z, w of a rotation (3, 3)."""
    quaternion = Rotation.from_matrix(rotation).as_quat()
    return np.asarray(quaternion if quaternion[3] >= 0.0 else -quaternion, dtype=np.float64)


def read_stamps(path: Path) -> Array:
    """Stamps in seconds, one number per line, strictly increasing. Raises CameraError."""
    _, rows = STAMPS.read(path, CameraError)
    check_increasing(path, rows[:, 0])
    return rows[:, 0]


def check_increasing(path: Path, stamps_s: Array) -> None:
    """Raises CameraError, naming the file and the place, where stamps do not strictly increase."""
    stuck = np.flatnonzero(np.diff(stamps_s) <= 0)
    if len(stuck):
        i = int(stuck[0])
        raise CameraError(
            f"{path}: stamp {i + 1} ({stamps_s[i + 1]} s) does not come after stamp {i} ({stamps_s[i]} s)"
        )


def rate_of_stamps(stamps_s: Array, default_hz: float) -> float:
    """Pictures per second by the median step; the default for a single one."""
    return float(1.0 / np.median(np.diff(stamps_s))) if len(stamps_s) > 1 else default_hz


def check_count(path: Path, count: int, pictures: int, where: Path) -> None:
    """Raises CameraError, with both numbers, where a file does not have one line per picture."""
    if count != pictures:
        raise CameraError(f"{path}: {count} lines for the {pictures} pictures in {where}")


def depth_beside(folder: Path, pictures: int, where: Path) -> tuple[Path, ...]:
    """The pictures in `depth/`, one for each of those in `where`; empty where there is no such folder. Raises
    CameraError."""
    depth = list_pictures(folder / "depth") if (folder / "depth").is_dir() else ()
    if depth:
        check_count(folder / "depth", len(depth), pictures, where)
    return depth


def trajectory(path: Path, stamps_s: Array, poses: tuple[SE2, ...]) -> Trajectory:
    """The drive's true trajectory, relative to its first pose. Raises CameraError that names the file."""
    try:
        return Trajectory(stamps_s, poses).from_start()
    except OdometryError as error:
        raise CameraError(f"{path}: {error}") from None


def up_vector(world_up: str) -> Array:
    """The unit vector, (3,), of an axis name such as `z` or `-y`."""
    vector = np.zeros(3)
    vector["xyz".index(world_up[-1])] = -1.0 if world_up.startswith("-") else 1.0
    return vector


def planarise_camera(poses_world_camera: Array, world_up: str, mount: Mount | None) -> tuple[SE2, ...]:
    """Camera-to-world poses as base poses relative to the first one: `pose_start_base`, the first the identity.

    poses_world_camera: (N, 4, 4), optical camera axes (x right, y down, z forward), metres. The heading is the
    horizontal part of the optical axis; the mount's lever arm (none without a mount) takes the lens to the turn axis.
    Raises CameraError where the camera looks straight up or down.
    """
    lens = _planar(poses_world_camera, world_up, OPTICAL_FORWARD)
    lever = SE2(mount.forward_m, mount.left_m, 0.0) if mount else SE2()
    return _from_first([pose @ lever.inverse() for pose in lens])


def upright_camera(poses_world_camera: Array, world_up: str, mount: Mount | None) -> Array:
    """Camera-to-world poses as (N, 4, 4) of the lens, base axes, in a z-up frame that starts where the first one is
    and heads where it looks: all six dimensions, levelled by the mount's angles alone."""
    up = up_vector(world_up)
    headings = poses_world_camera[:, :3, :3] @ np.array(OPTICAL_FORWARD)
    ahead = headings[0] - (headings[0] @ up) * up
    ahead /= np.linalg.norm(ahead)
    start_world = np.array([ahead, np.cross(up, ahead), up])
    optical_base = (mount or Mount(1.0)).rotation_base_optical().T
    poses = np.tile(np.eye(4), (len(poses_world_camera), 1, 1))
    poses[:, :3, :3] = start_world @ poses_world_camera[:, :3, :3] @ optical_base
    poses[:, :3, 3] = (poses_world_camera[:, :3, 3] - poses_world_camera[0, :3, 3]) @ start_world.T
    return poses


def camera_attitudes(stamps_s: Array, poses_world_camera: Array, world_up: str) -> AttitudeTrack:
    """Roll, pitch and rise of the lens from camera-to-world poses (N, 4, 4), optical camera axes."""
    up = up_vector(world_up)
    directions = np.einsum("nij,i->nj", poses_world_camera[:, :3, :3], up)
    return AttitudeTrack.of_up(stamps_s, directions, poses_world_camera[:, :3, 3] @ up)


def base_attitudes(stamps_s: Array, poses_world_base: Array, world_up: str, mount: Mount) -> AttitudeTrack | None:
    """Roll, pitch and rise of the lens from base-to-world poses (N, 4, 4), base axes; None where the base stays level
    and at one height."""
    up = up_vector(world_up)
    directions = np.einsum("nij,i->nj", poses_world_base[:, :3, :3], up)
    heights = poses_world_base[:, :3, 3] @ up + directions @ mount.position_base_m()
    if np.abs(directions[:, :2]).max() < LEVEL and np.ptp(heights) < LEVEL:
        return None
    return AttitudeTrack.of_up(stamps_s, directions @ mount.rotation_base_optical(), heights)


def planarise_base(poses_world_base: Array, world_up: str) -> tuple[SE2, ...]:
    """Base-to-world poses, (N, 4, 4), base axes as in REP-103, to `pose_start_base`."""
    return _from_first(_planar(poses_world_base, world_up, BASE_FORWARD))


def _planar(poses: Array, world_up: str, forward_axis: tuple[float, float, float]) -> list[SE2]:
    up = up_vector(world_up)
    headings = poses[:, :3, :3] @ np.array(forward_axis)
    headings = headings - np.outer(headings @ up, up)
    lengths = np.linalg.norm(headings, axis=1)
    if lengths.min() < 1e-3:
        raise CameraError(
            f"pose {int(lengths.argmin())} looks straight along world_up {world_up!r}: it has no heading; "
            "is world_up in camera.yaml the axis that points up?"
        )
    headings /= lengths[:, None]
    ahead = headings[0]
    left = np.cross(up, ahead)
    travelled = poses[:, :3, 3] - poses[0, :3, 3]
    yaws = np.arctan2(headings @ left, headings @ ahead)
    return [SE2(x, y, yaw) for x, y, yaw in zip(travelled @ ahead, travelled @ left, yaws, strict=True)]


def _from_first(poses: list[SE2]) -> tuple[SE2, ...]:
    origin = poses[0].inverse()
    return tuple(origin @ pose for pose in poses)
