"""Wheel odometry as a CSV: `stamp_s,x_m,y_m,yaw_rad`, the wheels' own integrated pose of the base."""

from __future__ import annotations

import csv
import math
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from edgemap.geometry.se2 import SE2
from edgemap.runtime.drives.pose_files import check_increasing, read_text
from edgemap.runtime.errors import CameraError

COLUMNS = ("stamp_s", "x_m", "y_m", "yaw_rad")


def read_wheel_csv(path: Path) -> tuple[NDArray[np.float64], tuple[SE2, ...]]:
    """Stamps (N,) in seconds, increasing, and the poses at them. Raises CameraError with the line number."""
    lines = read_text(path).splitlines()
    header = tuple(word.strip() for word in lines[0].split(",")) if lines else ()
    if header != COLUMNS:
        raise CameraError(f"{path}: first line must be {','.join(COLUMNS)}")
    rows = []
    for number, row in enumerate(csv.reader(lines[1:]), start=2):
        if not row:
            continue
        try:
            values = [float(word) for word in row]
        except ValueError:
            values = []
        if len(values) != 4 or not all(map(math.isfinite, values)):
            raise CameraError(f"{path}:{number}: expected 4 finite numbers, found {','.join(row)[:60]!r}")
        rows.append(values)
    if not rows:
        raise CameraError(f"{path}: no rows in it")
    stamps = np.array([row[0] for row in rows])
    check_increasing(path, stamps)
    return stamps, tuple(SE2(*row[1:]) for row in rows)


def write_wheel_csv(path: Path, rows: Iterable[Sequence[float]]) -> None:
    """Write rows (stamp_s, x_m, y_m, yaw_rad), micrometres and microradians kept."""
    with path.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(COLUMNS)
        writer.writerows([f"{value:.6f}" for value in row] for row in rows)
