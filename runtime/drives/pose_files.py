"""Text files of 3-D poses and of stamps, checked line by line."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from edgemap.geometry.se2 import SE2
from edgemap.runtime.errors import CameraError, OdometryError
from edgemap.runtime.trajectory import Trajectory

Array = NDArray[np.float64]


def read_text(path: Path) -> str:
    """The text of a file. Raises CameraError where it is missing or no text."""
    if not path.is_file():
        raise CameraError(f"{path}: no such file")
    try:
        return path.read_text()
    except (OSError, UnicodeDecodeError) as error:
        raise CameraError(f"{path}: cannot be read ({error})") from None


def read_matrices(path: Path, columns: int) -> Array:
    """Poses (N, 4, 4) from lines of 12 numbers (3x4, KITTI) or 16 (4x4), row-major, metres.

    Raises CameraError with the line number for a line of other length, NaN, or a matrix that is no rigid motion.
    """
    rows = np.array([row for _, row in _numbers(path, columns)])
    poses = np.tile(np.eye(4), (len(rows), 1, 1))
    poses.reshape(len(rows), 16)[:, :columns] = rows
    rotations = poses[:, :3, :3]
    errors = np.abs(rotations @ rotations.transpose(0, 2, 1) - np.eye(3)).max(axis=(1, 2))
    errors = np.maximum(errors, np.abs(np.linalg.det(rotations) - 1.0))
    if errors.max() > 0.05:
        worst = int(errors.argmax())
        raise CameraError(f"{path}: pose {worst} is no rigid motion (its rotation is off by {errors[worst]:.3g})")
    return poses


def read_tum_3d(path: Path) -> tuple[Array, Array]:
    """Stamps (N,) in seconds and poses (N, 4, 4) from a TUM file, `stamp x y z qx qy qz qw` per line.

    Raises CameraError with the line number for a line that is not eight finite numbers with a unit quaternion.
    """
    stamps, poses = [], []
    for number, row in _numbers(path, 8):
        norm = math.sqrt(sum(q * q for q in row[4:]))
        if abs(norm - 1.0) > 0.02:
            raise CameraError(f"{path}:{number}: quaternion has length {norm:.3f}, must be 1")
        x, y, z, w = (q / norm for q in row[4:])
        pose = np.eye(4)
        pose[:3, :3] = [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
        pose[:3, 3] = row[1:4]
        stamps.append(row[0])
        poses.append(pose)
    return np.array(stamps), np.array(poses)


def read_stamps(path: Path) -> Array:
    """Stamps in seconds, one number per line, strictly increasing. Raises CameraError."""
    stamps = np.array([row[0] for _, row in _numbers(path, 1)])
    check_increasing(path, stamps)
    return stamps


def check_increasing(path: Path, stamps_s: Array) -> None:
    """Raises CameraError, naming the file and the place, where stamps do not strictly increase."""
    stuck = np.flatnonzero(np.diff(stamps_s) <= 0)
    if len(stuck):
        i = int(stuck[0])
        raise CameraError(
            f"{path}: stamp {i + 1} ({stamps_s[i + 1]} s) does not come after stamp {i} ({stamps_s[i]} s)"
        )


def check_count(path: Path, count: int, pictures: int, where: Path) -> None:
    """Raises CameraError, with both numbers, where a file does not have one line per picture."""
    if count != pictures:
        raise CameraError(f"{path}: {count} lines for the {pictures} pictures in {where}")


def trajectory(path: Path, stamps_s: Array, poses: tuple[SE2, ...]) -> Trajectory:
    """The drive's truth, seen from its first pose; its errors name the file they came from as CameraError."""
    try:
        return Trajectory(stamps_s, poses).from_start()
    except OdometryError as error:
        raise CameraError(f"{path}: {error}") from None


def _numbers(path: Path, columns: int) -> list[tuple[int, list[float]]]:
    rows = []
    for number, line in enumerate(read_text(path).splitlines(), start=1):
        words = line.replace(",", " ").split()
        if not words or words[0].startswith("#"):
            continue
        try:
            row = [float(word) for word in words]
        except ValueError:
            raise CameraError(f"{path}:{number}: not numbers: {line.strip()[:60]!r}") from None
        if len(row) != columns:
            raise CameraError(f"{path}:{number}: {len(row)} numbers, expected {columns}")
        if not all(map(math.isfinite, row)):
            raise CameraError(f"{path}:{number}: not all numbers are finite: {line.strip()[:60]!r}")
        rows.append((number, row))
    if not rows:
        raise CameraError(f"{path}: no numbers in it")
    return rows
