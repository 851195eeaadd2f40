"""Text files of 3-D poses and of stamps, checked line by line."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from edgemap.geometry.arrays import Array
from edgemap.geometry.se2 import SE2
from edgemap.runtime.frames.errors import CameraError, OdometryError
from edgemap.runtime.frames.reading import read_bytes, read_text
from edgemap.runtime.frames.spatial_poses import poses_of
from edgemap.runtime.frames.tables import STAMP, Column, NumberTable
from edgemap.runtime.frames.trajectory import Trajectory, tum_rows
from edgemap.runtime.inputs.drives.pictures import list_pictures

STAMPS = NumberTable((STAMP,), samples=True)
MATRICES = {
    count: NumberTable(tuple(Column("xyzw"[i // 4] + "xyzt"[i % 4]) for i in range(count))) for count in (12, 16)
}


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


def read_stamps(path: Path) -> Array:
    """Stamps in seconds, one number per line, for one picture each: a wrong one is counted, and that between its
    neighbours taken. Raises CameraError."""
    good, stamps, lines = listed(path, 1)
    step_s = float(np.median(np.diff(stamps) / np.diff(good))) if len(good) > 1 else 0.0
    at = np.arange(len(lines))
    beyond = np.minimum(at - good[0], 0) + np.maximum(at - good[-1], 0)
    return np.interp(at, good, stamps) + step_s * beyond


def listed(path: Path, words: int) -> tuple[NDArray[np.intp], Array, list[str]]:
    """Numbers (N,) and stamps (N,) of the entries in a file that lists them, by lines of so many words that begin with
    one, and the texts of all entries; those whose stamp is none, or does not follow, are counted. Raises CameraError.
    """
    lines = _entries(path)
    texts = {number: f"? {line}" for number, line in lines}
    for number, line in lines:
        stamp, *others = line.split(maxsplit=1)
        if len(others) == words - 1 and line.isprintable():
            texts[number] = stamp
    data = "\n".join(texts.get(number, "") for number in range(1, 1 + max(texts)))
    numbers, rows = STAMPS.parse(data.encode(), str(path), CameraError)
    return np.searchsorted(list(texts), numbers), rows[:, 0], [line for _, line in lines]


def _entries(path: Path) -> list[tuple[int, str]]:
    """Numbers and texts of a file's lines that are no comments. Raises CameraError where there are none."""
    lines = enumerate(map(str.strip, read_text(path, CameraError).lstrip("\ufeff").splitlines()), 1)
    kept = [(number, line) for number, line in lines if line and not line.startswith("#")]
    if not kept:
        raise CameraError(f"{path}: nothing is listed in it")
    return kept


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
