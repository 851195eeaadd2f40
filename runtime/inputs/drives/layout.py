"""What all layouts of drives have in common: the camera of a folder, one row a picture, depth, the rate."""

from collections.abc import Sized
from dataclasses import replace
from pathlib import Path
from typing import TypeVar

import numpy as np

from edgemap.geometry.arrays import Array
from edgemap.runtime.frames.camera import DEFAULT_RATE_HZ
from edgemap.runtime.frames.errors import CameraError
from edgemap.runtime.inputs.drives.camera_yaml import read_camera_yaml
from edgemap.runtime.inputs.drives.drive import Drive, ridden
from edgemap.runtime.inputs.drives.pictures import list_pictures

Rows = TypeVar("Rows", bound=Sized)


def drive_of(kind: str, folder: Path, images: tuple[Path, ...] = (), world_up: str = "z") -> Drive:
    """Pictures with the camera of the folder's `camera.yaml`, where there is one, at stamps of number / rate, 10 a
    second by default. world_up: that of the layout, where the file states none. Raises CameraError, also for edgemap's
    layout without a `camera.yaml`."""
    path = folder / "camera.yaml"
    drive = Drive(kind, folder, images, np.arange(len(images)) / DEFAULT_RATE_HZ, world_up=world_up)
    if kind != "drive" and not path.is_file():
        return drive
    file = read_camera_yaml(path)
    return replace(
        drive,
        stamps_s=np.arange(len(images)) / (file.rate_hz or DEFAULT_RATE_HZ),
        intrinsics=file.intrinsics,
        mount=ridden(kind, file.mount),
        rate_hz=file.rate_hz,
        depth_camera=file.depth,
        world_up=file.world_up or world_up,
    )


def one_each(path: Path, rows: Rows, drive: Drive) -> Rows:
    """The rows of a file, of which there must be one for each picture. Raises CameraError with both numbers."""
    pictures = len(drive.images or drive.stamps_s)
    if len(rows) != pictures:
        where = drive.video or drive.images[0].parent
        raise CameraError(f"{path}: {len(rows)} lines for the {pictures} pictures in {where}")
    return rows


def with_depth(drive: Drive) -> Drive:
    """The drive with the pictures in `depth/`, where there is such a folder. Raises CameraError."""
    folder = drive.folder / "depth"
    return replace(drive, depth=one_each(folder, list_pictures(folder), drive)) if folder.is_dir() else drive


def rate_of_stamps(stamps_s: Array) -> float | None:
    """Pictures per second by the median step; None for a single one."""
    return float(1.0 / np.median(np.diff(stamps_s))) if len(stamps_s) > 1 else None
