"""Our own layout, KIND `drive`: pictures or a video, `camera.yaml`, base poses, and the simulator's truth.

images/…  or  video.mp4    pictures in natural order of names, or one compact video
camera.yaml                lens and mount
poses.tum                  base poses, one per picture (or at any stamps where stamps.txt is there)
stamps.txt                 optional; seconds, one per picture
objects.json, boxes.json   optional; see `write_drive`
wheel.csv                  optional; stamp_s,x_m,y_m,yaw_rad
imu.csv                    optional; stamp_s,gx,gy,gz,ax,ay,az: rad/s and m/s^2, the camera's optical frame
depth/…                    optional; 16-bit pictures, millimetres along the optical axis
"""

from pathlib import Path

import numpy as np

from edgemap.runtime.frames.errors import CameraError
from edgemap.runtime.inputs.drives.camera_yaml import DEFAULT_RATE_HZ, read_camera_yaml
from edgemap.runtime.inputs.drives.drive import Drive, LabelledBoxes
from edgemap.runtime.inputs.drives.pictures import list_pictures
from edgemap.runtime.inputs.drives.pose_files import (
    base_attitudes,
    check_count,
    check_increasing,
    planarise_base,
    read_stamps,
    read_tum_3d,
    trajectory,
)
from edgemap.runtime.inputs.drives.truth import read_boxes

VIDEO_NAME = "video.mp4"


def read_own(folder: Path) -> Drive:
    """Read a drive of our own layout. Raises CameraError for what is missing, broken, or does not match."""
    if not folder.is_dir():
        raise CameraError(f"{folder}: no such folder")
    camera = read_camera_yaml(folder / "camera.yaml")
    images, video = _pictures(folder)
    path = folder / "poses.tum"
    stamps, matrices = read_tum_3d(path)
    check_increasing(path, stamps)
    world_up = camera.world_up or "z"
    truth = trajectory(path, stamps, planarise_base(matrices, world_up))
    attitudes = base_attitudes(stamps, matrices, world_up, camera.mount) if camera.mount else None
    source = folder / "images" if images else folder / VIDEO_NAME
    if (folder / "stamps.txt").is_file():
        stamps = read_stamps(folder / "stamps.txt")
        if images:
            check_count(folder / "stamps.txt", len(stamps), len(images), source)
        first, last = truth.stamps_s[0], truth.stamps_s[-1]
        if stamps[0] < first - 0.15 or stamps[-1] > last + 0.15:
            raise CameraError(
                f"{path}: covers {first:.3f} to {last:.3f} s, the pictures lie at {stamps[0]:.3f} to {stamps[-1]:.3f} s"
            )
    elif images:
        check_count(path, len(stamps), len(images), source)
    boxes: tuple[LabelledBoxes, ...] = ()
    if (folder / "boxes.json").is_file():
        boxes = read_boxes(folder / "boxes.json")
        check_count(folder / "boxes.json", len(boxes), len(stamps), source)
    wheel = folder / "wheel.csv"
    depth = list_pictures(folder / "depth") if (folder / "depth").is_dir() else ()
    if depth:
        check_count(folder / "depth", len(depth), len(stamps), source)
    return Drive(
        "drive",
        folder,
        images,
        stamps,
        camera.intrinsics,
        camera.mount,
        camera.rate_hz or _rate(stamps),
        truth,
        boxes=boxes,
        wheel=wheel if wheel.is_file() else None,
        video=video,
        depth=depth,
        attitudes=attitudes,
    )


def _pictures(folder: Path) -> tuple[tuple[Path, ...], Path | None]:
    if (folder / "images").is_dir():
        return list_pictures(folder / "images"), None
    if (folder / VIDEO_NAME).is_file():
        return (), folder / VIDEO_NAME
    raise CameraError(f"{folder}: neither images/ nor {VIDEO_NAME} in it")


def _rate(stamps: np.ndarray) -> float:
    return float(1.0 / np.median(np.diff(stamps))) if len(stamps) > 1 else DEFAULT_RATE_HZ
