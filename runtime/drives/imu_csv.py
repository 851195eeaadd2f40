"""Inertial samples as a CSV: `stamp_s,gx,gy,gz,ax,ay,az`, rad/s and m/s^2 in the camera's optical frame."""

from pathlib import Path

from edgemap.geometry.camera.imu import ImuSamples
from edgemap.runtime.drives.pose_files import check_increasing
from edgemap.runtime.errors import CameraError
from edgemap.runtime.number_rows import STAMP, NumberTable, columns

RATES = (*columns("gx gy gz", -100.0, 100.0), *columns("ax ay az", -1000.0, 1000.0))
IMU = NumberTable((STAMP, *RATES), ",", header=True)


def read_imu_csv(path: Path) -> ImuSamples:
    """Read `imu.csv`. Raises CameraError with the line number for a row that is not seven finite numbers in range."""
    _, rows = IMU.read(path, CameraError)
    check_increasing(path, rows[:, 0])
    return ImuSamples(rows[:, 0], rows[:, 1:4], rows[:, 4:7])


def write_imu_csv(path: Path, samples: ImuSamples) -> None:
    """Write samples that `read_imu_csv` reads back; stamps in microseconds, values to seven digits."""
    with path.open("w") as file:
        file.write(",".join(column.name for column in IMU.columns) + "\n")
        for stamp_s, rate, force in zip(samples.stamps_s, samples.gyro_rad_s, samples.accel_m_s2, strict=True):
            file.write(f"{stamp_s:.6f}," + ",".join(f"{value:.7g}" for value in (*rate, *force)) + "\n")
