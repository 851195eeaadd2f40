"""Wheels and IMU of a drive as CSV: `stamp_s,x_m,y_m,yaw_rad`, and `stamp_s,gx,gy,gz,ax,ay,az` in the optical frame."""

from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from edgemap.geometry.camera.imu import ImuSamples
from edgemap.geometry.se2 import SE2
from edgemap.runtime.frames.errors import CameraError
from edgemap.runtime.frames.notes import note_dropped
from edgemap.runtime.frames.tables import STAMP, NumberTable, columns
from edgemap.runtime.frames.trajectory import FASTEST_M_S

WHEEL = NumberTable((STAMP, *columns("x_m y_m yaw_rad")), header=True, samples=True)
COLUMNS = tuple(column.name for column in WHEEL.columns)
SHORTEST_JUMP_M = 10.0  # smaller ones are left to what weighs the sources against each other
RATES = (*columns("gx gy gz", -100.0, 100.0), *columns("ax ay az", -1000.0, 1000.0))
IMU = NumberTable((STAMP, *RATES), header=True, samples=True)


def read_wheel_csv(path: Path) -> tuple[NDArray[np.float64], tuple[SE2, ...]]:
    """Stamps (N,) in seconds, increasing, and the poses at them.

    Rows that are no samples are dropped and counted. Raises CameraError where most are none, and where the pose jumps
    for good.
    """
    _, rows = WHEEL.read(path, CameraError)
    try:
        kept, jumps = steady(rows[:, 0], rows[:, 1:3])
    except CameraError as error:
        raise CameraError(f"{path}: {error}") from None
    note_dropped(path, jumps, len(rows))
    return rows[kept, 0], tuple(SE2(*row) for row in rows[kept, 1:].tolist())


def steady(stamps_s: NDArray[np.float64], positions_m: NDArray[np.float64]) -> tuple[list[int], list[str]]:
    """Indices of the positions (N, 2) that wheels can reach, and why the others are left out: single ones to which they
    would have rolled faster than FASTEST_M_S. Raises CameraError where they stay there."""
    kept, wrong = [0], list[str]()
    if len(stamps_s) > 2 and _jump(stamps_s, positions_m, 0, 1) and not _jump(stamps_s, positions_m, 1, 2):
        kept, wrong = [], [_jump(stamps_s, positions_m, 0, 1)]
    for at in range(1, len(stamps_s)):
        jump = _jump(stamps_s, positions_m, kept[-1], at) if kept else ""
        if not jump:
            kept.append(at)
        elif at + 1 < len(stamps_s) and not _jump(stamps_s, positions_m, at, at + 1):
            raise CameraError(f"wheels: {jump}, and stays there")
        else:
            wrong.append(jump)
    if 2 * len(kept) <= len(stamps_s) and wrong:
        raise CameraError(f"wheels: {wrong[0]}")
    return kept, wrong


def _jump(stamps_s: NDArray[np.float64], positions_m: NDArray[np.float64], one: int, other: int) -> str:
    """Why wheels do not get from one sample to another one; empty where they do."""
    span_s, jump_m = stamps_s[other] - stamps_s[one], float(np.linalg.norm(positions_m[other] - positions_m[one]))
    if jump_m <= max(FASTEST_M_S * span_s, SHORTEST_JUMP_M):
        return ""
    rolls = f"wheels roll {FASTEST_M_S:g} m/s at most"
    return f"at {stamps_s[other]:.3f} s the pose jumps {jump_m:.1f} m in {span_s:.3f} s, {rolls}"


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
