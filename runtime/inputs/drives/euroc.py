"""EuRoC MAV: `cam0` and `imu0` of one flight with its ground truth, as published (`mav0/…`) or in one flat folder.

    mav0/cam0/data/*.png, mav0/imu0/data.csv, mav0/state_groundtruth_estimate0/data.csv, sensor.yaml beside each
    image/*, imu.csv, cam0.yaml, imu.yaml, truth.txt (stamp_ns x y z qx qy qz qw, of the camera's frame)

A picture's name is its stamp in nanoseconds. IMU samples are turned into the camera's optical frame by both `T_BS`.
"""

from dataclasses import replace
from itertools import compress
from pathlib import Path
from typing import Annotated

import msgspec
import numpy as np
from msgspec import Meta

from edgemap.geometry.arrays import Array
from edgemap.geometry.camera.imu import ImuSamples
from edgemap.runtime.frames.errors import CameraError
from edgemap.runtime.frames.reading import Coordinate, convert, read_bytes
from edgemap.runtime.frames.spatial_poses import attitudes_of, planarise, poses_of
from edgemap.runtime.frames.tables import Column, NumberTable, columns
from edgemap.runtime.frames.trajectory import Trajectory, tum_rows
from edgemap.runtime.frames.yaml_file import read_yaml
from edgemap.runtime.inputs.drives.drive import Drive
from edgemap.runtime.inputs.drives.layout import drive_of, rate_of_stamps
from edgemap.runtime.inputs.drives.lens_files import read_foreign_lens
from edgemap.runtime.inputs.drives.pictures import list_pictures
from edgemap.runtime.inputs.drives.sensor_csv import RATES

STAMP_NS = Column("stamp_ns", 0.0, 1e19)
SAMPLES = NumberTable((STAMP_NS, *RATES), samples=True)
BODY = NumberTable(
    (STAMP_NS, *columns("x y z"), *columns("qw qx qy qz", -1.01, 1.01), *columns("vx vy vz bgx bgy bgz bax bay baz"))
)
CAMERA = NumberTable((STAMP_NS, *columns("x y z qx qy qz qw")))

# Pictures, camera, IMU samples, IMU, truth.
PUBLISHED = (
    "mav0/cam0/data", "mav0/cam0/sensor.yaml", "mav0/imu0/data.csv", "mav0/imu0/sensor.yaml",
    "mav0/state_groundtruth_estimate0/data.csv",
)  # fmt: skip
FLAT = ("image", "cam0.yaml", "imu.csv", "imu.yaml", "truth.txt")


class _Pose(msgspec.Struct):
    data: Annotated[list[Coordinate], Meta(min_length=16, max_length=16)]

    @property
    def rotation(self) -> Array:
        return np.array(self.data).reshape(4, 4)[:3, :3]


class _Sensor(msgspec.Struct):
    T_BS: _Pose


def read_euroc(folder: Path) -> Drive:
    """Read a flight; stamps are seconds since its first IMU sample. A `camera.yaml` may add a mount.

    The published truth is of the body; its rotation is taken to the camera's, its lever arm of a few centimetres is
    not. Pictures that the truth does not cover are left out. Raises CameraError.
    """
    published = (folder / "mav0").is_dir()
    pictures, camera_yaml, imu, imu_yaml, truth = (folder / name for name in (PUBLISHED if published else FLAT))
    drive = drive_of("euroc", folder, list_pictures(pictures))
    camera_body = _rotation(camera_yaml)
    imu_body = _rotation(imu_yaml) if imu_yaml.is_file() else np.eye(3)
    _, rows = SAMPLES.read(imu, CameraError)
    start_ns = rows[0, 0]
    samples = ImuSamples((rows[:, 0] - start_ns) * 1e-9, rows[:, 1:4], rows[:, 4:7])
    truth_stamps, poses = _poses(truth, start_ns, camera_body if published else None)
    taken = np.array([(_stamp_ns(path) - start_ns) * 1e-9 for path in drive.images])
    if (np.diff(taken) <= 0.0).any():
        raise CameraError(f"{pictures}: two pictures have one stamp")
    known = (taken >= truth_stamps[0] - 0.01) & (taken <= truth_stamps[-1] + 0.01)
    if not known.any():
        first, last = truth_stamps[0], truth_stamps[-1]
        raise CameraError(f"{truth}: covers {first:.3f} to {last:.3f} s, no picture lies in it")
    lens = read_foreign_lens(camera_yaml)
    return replace(
        drive,
        images=tuple(compress(drive.images, known)),
        stamps_s=taken[known],
        intrinsics=drive.intrinsics or lens,
        rate_hz=rate_of_stamps(taken) or drive.rate_hz,
        truth=Trajectory(truth_stamps, planarise(poses, drive.world_up, "z", drive.mount)),
        attitudes=attitudes_of(truth_stamps, poses, drive.world_up),
        imu=samples.rotated(camera_body.T @ imu_body),
    )


def _poses(path: Path, start_ns: float, camera_body: Array | None) -> tuple[Array, Array]:
    """Stamps (N,) in seconds and poses (N, 4, 4) with the camera's rotation. camera_body: that of the camera on the
    body, for poses of the body."""
    if camera_body is None:
        rows = tum_rows(read_bytes(path, CameraError), str(path), CameraError, CAMERA)
        camera_body = np.eye(3)
    else:
        rows = BODY.read(path, CameraError)[1][:, [0, 1, 2, 3, 5, 6, 7, 4]]
    stamps, poses = (rows[:, 0] - start_ns) * 1e-9, poses_of(rows[:, 1:4], rows[:, 4:])
    poses[:, :3, :3] = poses[:, :3, :3] @ camera_body
    return stamps, poses


def _rotation(path: Path) -> Array:
    """A sensor's, (3, 3), to the body."""
    return convert(read_yaml(path, CameraError), _Sensor, path, CameraError, strict=False).T_BS.rotation


def _stamp_ns(path: Path) -> float:
    if not path.stem.isdecimal() or len(path.stem) > 19:
        raise CameraError(f"{path}: a EuRoC picture is named after its stamp in nanoseconds")
    return float(path.stem)
