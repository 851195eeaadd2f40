"""edgemap's layout, KIND `drive`: pictures or a video, `camera.yaml`, base poses, truth; read and written.

images/…  or  video.mp4    pictures in natural order of names, or one compact video
camera.yaml                lens and mount
poses.tum                  base poses, one per picture (or at any stamps where stamps.txt is there)
stamps.txt                 optional; seconds, one per picture
objects.json, boxes.json   optional; see `write_drive`
wheel.csv                  optional; stamp_s,x_m,y_m,yaw_rad
imu.csv                    optional; stamp_s,gx,gy,gz,ax,ay,az: rad/s and m/s^2, the camera's optical frame
depth/…                    optional; 16-bit pictures, millimetres along the optical axis, registered to the pictures,
                           or with their camera as `depth` in `camera.yaml`
"""

import json
import math
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from edgemap.geometry.se2 import SE2
from edgemap.runtime.frames.errors import CameraError
from edgemap.runtime.frames.spatial_poses import attitudes_of, planarise, up_vector
from edgemap.runtime.frames.trajectory import EDGE_S, Trajectory, tum_line
from edgemap.runtime.inputs.drives.camera_yaml import CameraFile, write_camera_yaml
from edgemap.runtime.inputs.drives.drive import Drive
from edgemap.runtime.inputs.drives.layout import drive_of, one_each, rate_of_stamps, with_depth
from edgemap.runtime.inputs.drives.pictures import list_pictures
from edgemap.runtime.inputs.drives.pose_files import read_stamps, read_tum_3d
from edgemap.runtime.inputs.drives.sensor_csv import read_wheel_csv, write_wheel_csv
from edgemap.runtime.inputs.drives.truth import read_boxes

VIDEO_NAME = "video.mp4"


def read_own(folder: Path) -> Drive:
    """Read a drive of edgemap's layout. Raises CameraError for what is missing, broken, or does not match."""
    if not folder.is_dir():
        raise CameraError(f"{folder}: no such folder")
    drive = drive_of("drive", folder)
    images, video = folder / "images", folder / VIDEO_NAME
    if images.is_dir():
        drive = replace(drive, images=list_pictures(images))
    elif video.is_file():
        drive = replace(drive, video=video)
    else:
        raise CameraError(f"{folder}: neither images/ nor {VIDEO_NAME} in it")
    path, listed, known, wheel = (folder / name for name in ("poses.tum", "stamps.txt", "boxes.json", "wheel.csv"))
    stamps, matrices = read_tum_3d(path)
    upright = float(np.median(matrices[:, :3, 2] @ up_vector(drive.world_up)))
    if upright < 0.5:  # 60 degrees
        off_deg = math.degrees(math.acos(max(upright, -1.0)))
        raise CameraError(
            f"{path}: its z axes are {off_deg:.0f} deg off world_up: a drive has poses of its base, x ahead and z up; "
            "those of a camera's optical axes are read by --odometry FILE.tum"
        )
    truth = Trajectory(stamps, planarise(matrices, drive.world_up, "x"))
    attitudes = attitudes_of(stamps, matrices, drive.world_up, drive.mount) if drive.mount else None
    if listed.is_file():
        stamps = read_stamps(listed)
    drive = replace(drive, stamps_s=stamps, rate_hz=drive.rate_hz or rate_of_stamps(stamps))
    one_each(listed if listed.is_file() else path, stamps, drive)
    first, last = truth.stamps_s[0], truth.stamps_s[-1]
    if stamps[0] < first - EDGE_S or stamps[-1] > last + EDGE_S:
        raise CameraError(
            f"{path}: covers {first:.3f} to {last:.3f} s, the pictures lie at {stamps[0]:.3f} to {stamps[-1]:.3f} s"
        )
    if known.is_file():
        drive = replace(drive, boxes=one_each(known, read_boxes(known), drive))
    wheels = read_wheel_csv(wheel) if wheel.is_file() else None
    return with_depth(replace(drive, truth=truth, attitudes=attitudes, wheel=wheels))


def write_drive(
    folder: Path,
    camera: CameraFile,
    poses: Trajectory,
    objects: Sequence[dict[str, Any]] | None = None,
    boxes: Sequence[Sequence[dict[str, Any]]] | None = None,
    wheel: Iterable[Sequence[float]] | None = None,
    tilts: NDArray[np.float64] | None = None,
) -> None:
    """Write `camera.yaml`, `poses.tum` and optionally `objects.json`, `boxes.json` and `wheel.csv`.

    poses: of the base, one per picture, at the pictures' stamps. objects: records in the start-pose frame, `{"id",
    "label", "x_m", "y_m", "on_floor", "footprint_m": [[x, y], ...], "width_m", "depth_m", "height_m",
    "visible_frames"}`. boxes: one list per picture of `{"id", "label", "box": [x0, y0, x1, y1] in px, "visible":
    0..1}`. wheel: rows (stamp_s, x_m, y_m, yaw_rad), the integrated pose of the wheels. tilts: (N, 3) of the base at
    each pose: roll, pitch (positive down) in rad, and rise in metres. Pictures go to `images/` (natural order of names)
    or one `video.mp4`; both are the caller's. Makes the folder.
    """
    folder.mkdir(parents=True, exist_ok=True)
    write_camera_yaml(folder / "camera.yaml", camera)
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
    quaternion = Rotation.from_euler("ZYX", [pose.yaw_rad, tilt[1], tilt[0]]).as_quat()
    return " ".join(f"{value:.9f}" for value in (stamp_s, pose.x_m, pose.y_m, tilt[2], *quaternion)) + "\n"
