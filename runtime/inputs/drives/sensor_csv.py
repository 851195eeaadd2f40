"""Wheels and IMU of a drive as CSV: `stamp_s,x_m,y_m,yaw_rad`, and `stamp_s,gx,gy,gz,ax,ay,az` in the optical frame."""

from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

from edgemap.geometry.camera.imu import ImuSamples
from edgemap.geometry.se2 import SE2
from edgemap.runtime.frames.errors import CameraError
from edgemap.runtime.frames.tables import STAMP, NumberTable, columns
from edgemap.runtime.frames.trajectory import Trajectory

WHEEL = NumberTable((STAMP, *columns("x_m y_m yaw_rad")), header=True, samples=True)
COLUMNS = tuple(column.name for column in WHEEL.columns)
RATES = (*columns("gx gy gz", -100.0, 100.0), *columns("ax ay az", -1000.0, 1000.0))
IMU = NumberTable((STAMP, *RATES), header=True, samples=True)


def read_wheel_csv(path: Path) -> Trajectory:
    """The wheels' poses; rows that are no samples are dropped and counted. Raises CameraError where most are none."""
    _, rows = WHEEL.read(path, CameraError)
    return Trajectory(rows[:, 0], tuple(SE2(*row) for row in rows[:, 1:].tolist()))


def write_wheel_csv(path: Path, rows: Iterable[Sequence[float]]) -> None:
    """Write rows (stamp_s, x_m, y_m, yaw_rad), micrometres and microradians kept."""
    values = np.array([*rows], dtype=np.float64).reshape(-1, len(COLUMNS))
    np.savetxt(path, values, "%.6f", ",", "\r\n", ",".join(COLUMNS), comments="")


def read_imu_csv(path: Path) -> ImuSamples:
    """Read `imu.csv`; rows that are no samples are dropped and counted. Raises CameraError where most are none."""
    _, rows = IMU.read(path, CameraError)
    return ImuSamples(rows[:, 0], rows[:, 1:4], rows[:, 4:7])


def write_imu_csv(path: Path, samples: ImuSamples) -> None:
    """Write samples that `read_imu_csv` reads back; stamps in microseconds, values to seven digits."""
    rows = np.column_stack([samples.stamps_s, samples.gyro_rad_s, samples.accel_m_s2])
    header = ",".join(column.name for column in IMU.columns)
    np.savetxt(path, rows, ["%.6f"] + ["%.7g"] * 6, ",", header=header, comments="")
