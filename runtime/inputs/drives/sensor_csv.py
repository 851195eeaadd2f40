"""Wheels and IMU of a drive as CSV: `stamp_s,x_m,y_m,yaw_rad`, and `stamp_s,gx,gy,gz,ax,ay,az` in the optical frame."""

from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from edgemap.geometry.camera.imu import ImuSamples
from edgemap.geometry.se2 import SE2
from edgemap.runtime.frames.errors import CameraError
from edgemap.runtime.frames.tables import STAMP, NumberTable, columns
from edgemap.runtime.frames.trajectory import FASTEST_M_S
from edgemap.runtime.inputs.drives.pose_files import check_increasing

WHEEL = NumberTable((STAMP, *columns("x_m y_m yaw_rad")), header=True)
COLUMNS = tuple(column.name for column in WHEEL.columns)
SHORTEST_JUMP_M = 10.0  # smaller ones are left to what weighs the sources against each other
RATES = (*columns("gx gy gz", -100.0, 100.0), *columns("ax ay az", -1000.0, 1000.0))
IMU = NumberTable((STAMP, *RATES), header=True)


def read_wheel_csv(path: Path) -> tuple[NDArray[np.float64], tuple[SE2, ...]]:
    """Stamps (N,) in seconds, increasing, and the poses at them.

    Raises CameraError with the line number, also where the pose jumps.
    """
    numbers, rows = WHEEL.read(path, CameraError)
    stamps = rows[:, 0]
    check_increasing(path, stamps)
    poses = tuple(SE2(*row) for row in rows[:, 1:].tolist())
    check_speed(f"{path}: line", stamps, rows[:, 1:3], numbers)
    return stamps, poses


def check_speed(where: str, stamps_s: NDArray[np.float64], positions_m: NDArray[np.float64], names: list[int]) -> None:
    """Raises CameraError where wheels would have rolled faster than FASTEST_M_S."""
    jumps_m = np.linalg.norm(np.diff(positions_m, axis=0), axis=1)
    fast = np.flatnonzero(jumps_m > np.maximum(FASTEST_M_S * np.diff(stamps_s), SHORTEST_JUMP_M))
    if len(fast):
        first = int(fast[0])
        raise CameraError(
            f"{where} {names[first + 1]}: the pose jumps {jumps_m[first]:.1f} m in "
            f"{stamps_s[first + 1] - stamps_s[first]:.3f} s, wheels roll {FASTEST_M_S:g} m/s at most"
        )


def write_wheel_csv(path: Path, rows: Iterable[Sequence[float]]) -> None:
    """Write rows (stamp_s, x_m, y_m, yaw_rad), micrometres and microradians kept."""
    values = np.array([*rows], dtype=np.float64).reshape(-1, len(COLUMNS))
    np.savetxt(path, values, "%.6f", ",", "\r\n", ",".join(COLUMNS), comments="")


def read_imu_csv(path: Path) -> ImuSamples:
    """Read `imu.csv`. Raises CameraError with the line number for a row that is not seven finite numbers in range."""
    _, rows = IMU.read(path, CameraError)
    check_increasing(path, rows[:, 0])
    return ImuSamples(rows[:, 0], rows[:, 1:4], rows[:, 4:7])


def write_imu_csv(path: Path, samples: ImuSamples) -> None:
    """Write samples that `read_imu_csv` reads back; stamps in microseconds, values to seven digits."""
    rows = np.column_stack([samples.stamps_s, samples.gyro_rad_s, samples.accel_m_s2])
    header = ",".join(column.name for column in IMU.columns)
    np.savetxt(path, rows, ["%.6f"] + ["%.7g"] * 6, ",", header=header, comments="")
