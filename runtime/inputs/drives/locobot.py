"""LoCoBot: `rgb/` and `depth/` pictures, 640x480, with the base's wheel odometry.

    rgb/000000.png …       colour, one per stamp (any picture format)
    depth/000000.png …     optional; 16-bit, millimetres, aligned with rgb/ and as many
    odometry.csv           stamp_s,x_m,y_m,yaw_rad: integrated wheel odometry, one row per picture
    camera.yaml            lens and mount
    poses.tum              optional; base poses from something better than wheels, one per picture

No public data in this form exists; the layout is edgemap's. Truth is `poses.tum` where it is there, else the wheel
odometry itself, which drifts.
"""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path

from edgemap.runtime.frames.spatial_poses import planarise
from edgemap.runtime.frames.trajectory import Trajectory, tum_line
from edgemap.runtime.inputs.drives.camera_yaml import CameraFile, write_camera_yaml
from edgemap.runtime.inputs.drives.drive import Drive
from edgemap.runtime.inputs.drives.layout import drive_of, one_each, with_depth
from edgemap.runtime.inputs.drives.pictures import list_pictures
from edgemap.runtime.inputs.drives.pose_files import read_tum_3d
from edgemap.runtime.inputs.drives.sensor_csv import read_wheel_csv, write_wheel_csv


def read_locobot(folder: Path) -> Drive:
    """Read a LoCoBot folder as described above. Raises CameraError."""
    drive = with_depth(drive_of("locobot", folder, list_pictures(folder / "rgb")))
    wheel_path, better = folder / "odometry.csv", folder / "poses.tum"
    wheel = read_wheel_csv(wheel_path)
    truth = wheel.from_start()
    one_each(wheel_path, wheel.stamps_s, drive)
    if better.is_file():
        matrices = one_each(better, read_tum_3d(better)[1], drive)
        truth = Trajectory(wheel.stamps_s, planarise(matrices, drive.world_up, "x"))
    return replace(drive, stamps_s=wheel.stamps_s, truth=truth, wheel=wheel)


def write_locobot(
    folder: Path,
    camera: CameraFile,
    odometry: Iterable[Sequence[float]],
    poses: Trajectory | None = None,
) -> None:
    """Write everything next to the pictures: `camera.yaml`, `odometry.csv`, and `poses.tum` with a truth.

    odometry: rows (stamp_s, x_m, y_m, yaw_rad), one per picture. Pictures in `rgb/` and `depth/` are the caller's.
    """
    folder.mkdir(parents=True, exist_ok=True)
    write_camera_yaml(folder / "camera.yaml", camera)
    write_wheel_csv(folder / "odometry.csv", odometry)
    if poses is not None:
        lines = [tum_line(stamp, pose) for stamp, pose in zip(poses.stamps_s, poses.poses, strict=True)]
        (folder / "poses.tum").write_text("".join(lines))
