"""Writes our own drive layout: everything beside the pictures, which the caller writes himself."""

import json
from collections.abc import Iterable, Sequence
from math import cos, sin
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from edgemap.geometry.camera.intrinsics import Intrinsics
from edgemap.geometry.camera.mount import Mount
from edgemap.geometry.se2 import SE2
from edgemap.runtime.frames.trajectory import Trajectory, tum_line
from edgemap.runtime.inputs.drives.camera_yaml import write_camera_yaml
from edgemap.runtime.inputs.drives.sensor_csv import write_wheel_csv


def write_drive(
    folder: str | Path,
    intrinsics: Intrinsics,
    mount: Mount,
    rate_hz: float,
    poses: Trajectory,
    objects: Sequence[dict[str, Any]] | None = None,
    boxes: Sequence[Sequence[dict[str, Any]]] | None = None,
    wheel: Iterable[Sequence[float]] | None = None,
    tilts: NDArray[np.float64] | None = None,
) -> None:
    """Write `camera.yaml`, `poses.tum` and, where given, `objects.json`, `boxes.json` and `wheel.csv`.

    poses: of the base, one per picture, at the pictures' stamps. objects: records in the start-pose frame,
    `{"id", "label", "x_m", "y_m", "on_floor", "footprint_m": [[x, y], ...], "width_m", "depth_m", "height_m",
    "visible_frames"}`. boxes: one list per picture of `{"id", "label", "box": [x0, y0, x1, y1] in px,
    "visible": 0..1}`. wheel: rows (stamp_s, x_m, y_m, yaw_rad), the wheels' own integrated pose.
    tilts: (N, 3) of the base at each pose: roll, pitch (positive down) in rad, and rise in metres.
    Pictures go to `images/` (natural order of names) or one `video.mp4`; both are the caller's. Makes the folder.
    """
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    write_camera_yaml(folder / "camera.yaml", intrinsics, mount, rate_hz)
    rows = zip(poses.stamps_s, poses.poses, strict=True)
    lines = (tum_line(stamp, pose) for stamp, pose in rows)
    if tilts is not None:
        lines = (_tilted_line(stamp, pose, tilt) for (stamp, pose), tilt in zip(rows, tilts, strict=True))
    (folder / "poses.tum").write_text("# base poses: stamp x y z qx qy qz qw\n" + "".join(lines))
    if objects is not None:
        (folder / "objects.json").write_text(json.dumps({"objects": list(objects)}, indent=1))
    if boxes is not None:
        (folder / "boxes.json").write_text(json.dumps({"frames": [list(frame) for frame in boxes]}))
    if wheel is not None:
        write_wheel_csv(folder / "wheel.csv", wheel)


def _tilted_line(stamp_s: float, pose: SE2, tilt: NDArray[np.float64]) -> str:
    """A line of a TUM file: yaw, then pitch, then roll about the base's axes."""
    (cr, cp, cy), (sr, sp, sy) = ([f(angle / 2.0) for angle in (tilt[0], tilt[1], pose.yaw_rad)] for f in (cos, sin))
    quaternion = (
        sr * cp * cy - cr * sp * sy, cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy, cr * cp * cy + sr * sp * sy,
    )  # fmt: skip
    return " ".join(f"{value:.9f}" for value in (stamp_s, pose.x_m, pose.y_m, tilt[2], *quaternion)) + "\n"
