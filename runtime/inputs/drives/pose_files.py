"""Text files of 3-D poses and of stamps, checked line by line."""

from pathlib import Path

import numpy as np

from edgemap.geometry.arrays import Array
from edgemap.runtime.frames.errors import CameraError
from edgemap.runtime.frames.reading import read_bytes
from edgemap.runtime.frames.spatial_poses import poses_of
from edgemap.runtime.frames.tables import STAMP, Column, NumberTable
from edgemap.runtime.frames.trajectory import tum_rows

STAMPS = NumberTable((STAMP,))


def read_matrices(path: Path, columns: int) -> Array:
    """Poses (N, 4, 4) from lines of 12 numbers (3x4, KITTI) or 16 (4x4), row-major, metres.

    Raises CameraError with the line number for a line of other length, NaN, or a matrix that is not a rigid motion.
    """
    table = NumberTable(tuple(Column("xyzw"[at // 4] + "xyzt"[at % 4]) for at in range(columns)))
    _, rows = table.read(path, CameraError)
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


def read_stamps(path: Path) -> Array:
    """Stamps in seconds that increase, one number per line, for one picture each. Raises CameraError with the line."""
    return increasing(path, *STAMPS.read(path, CameraError))


def increasing(path: Path, numbers: list[int], rows: Array) -> Array:
    """The stamps (N,) of a table's rows. Raises CameraError with the line where one is not after the last."""
    stamps = rows[:, 0]
    for at in np.flatnonzero(np.diff(stamps) <= 0.0):
        raise CameraError(f"{path}:{numbers[at + 1]}: {stamps[at + 1]:.6f} s is not after {stamps[at]:.6f} s")
    return stamps
