"""Pictures with camera-to-world poses in `poses.txt`: KIND `c2w`, a 4x4 a line, and KITTI odometry, a 3x4 a line."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from edgemap.geometry.camera.intrinsics import Intrinsics
from edgemap.geometry.errors import GeometryError
from edgemap.runtime.frames.errors import CameraError
from edgemap.runtime.frames.faults import FaultKind
from edgemap.runtime.frames.notes import note
from edgemap.runtime.frames.reading import read_text
from edgemap.runtime.frames.spatial_poses import attitudes_of, planarise, upright_camera
from edgemap.runtime.frames.trajectory import Trajectory
from edgemap.runtime.inputs.drives.camera_yaml import read_setup
from edgemap.runtime.inputs.drives.drive import Drive, ridden
from edgemap.runtime.inputs.drives.pictures import first_folder, list_pictures, read_picture
from edgemap.runtime.inputs.drives.pose_files import check_count, depth_beside, read_matrices, read_stamps


def read_kitti(folder: Path) -> Drive:
    """Read a KITTI sequence. The world is the first camera's: its y points down, so up is `-y` by default.

    Its mount is a car's. `times.txt`, one stamp in seconds per line, is used where present. Raises CameraError.
    """
    return _read("kitti", folder, ("image", "image_2", "images"), 12, "-y", ("times.txt",))


def read_c2w(folder: Path) -> Drive:
    """Read pictures with 4x4 camera-to-world lines, optical camera axes, metres; the world is z-up by default.

    `K.txt`, 3x3 in px, is used where no camera.yaml is. `stamps.txt` or `times.txt` in seconds where present. `depth/`:
    a 16-bit picture of millimetres for each picture, 0 where unknown, registered to it unless `camera.yaml` states its
    camera's pose. Raises CameraError.
    """
    return _read("c2w", folder, ("image", "images"), 16, "z", ("stamps.txt", "times.txt"), "K.txt")


def _read(
    kind: str, folder: Path, names: tuple[str, ...], columns: int, world_up: str, times: tuple[str, ...], k: str = ""
) -> Drive:
    """Pictures in the first folder of these names, or in the folder itself."""
    pictures_folder = first_folder(folder, names)
    images = list_pictures(pictures_folder)
    known = k and (folder / k).is_file() and not (folder / "camera.yaml").is_file()
    setup = read_setup(folder, world_up, _read_k(folder / k, images[0]) if known else None)
    setup = replace(setup, mount=ridden(kind, setup.mount))
    path = folder / "poses.txt"
    poses = read_matrices(path, columns)
    check_count(path, len(poses), len(images), pictures_folder)
    stamps = np.arange(len(images)) / setup.rate_hz
    if stated := next((folder / name for name in times if (folder / name).is_file()), None):
        stamps = read_stamps(stated)
        check_count(stated, len(stamps), len(images), pictures_folder)
    depth = depth_beside(folder, len(images), pictures_folder) if kind == "c2w" else ()
    drive = Drive(
        kind, folder, images, stamps, setup.intrinsics, setup.mount, setup.rate_hz, None, depth=depth,
        depth_camera=setup.depth,
    )  # fmt: skip
    try:
        planar = planarise(poses, setup.world_up, "z", setup.mount)
        full = upright_camera(poses, setup.world_up, setup.mount)
    except CameraError as error:  # the pictures can be driven without
        note(FaultKind.SAMPLES, f"{path}: no true poses: {error}")
        return drive
    attitudes = attitudes_of(stamps, poses, setup.world_up) if kind == "c2w" else None
    return replace(drive, truth=Trajectory(stamps, planar), full_poses=full, attitudes=attitudes)


def _read_k(path: Path, first_picture: Path) -> Intrinsics:
    height, width = read_picture(first_picture).shape[:2]
    try:
        numbers = [float(word) for word in read_text(path, CameraError).split()]
        if len(numbers) != 9:
            raise CameraError(f"{path}: {len(numbers)} numbers, expected a 3x3 matrix")
        return Intrinsics(width, height, numbers[0], numbers[4], numbers[2], numbers[5])
    except ValueError:
        raise CameraError(f"{path}: not numbers, expected a 3x3 matrix") from None
    except GeometryError as error:
        raise CameraError(f"{path}: {error}") from None
