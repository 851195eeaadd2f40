"""Pictures with camera-to-world poses in `poses.txt`: KIND `c2w`, a 4x4 a line, and KITTI odometry, a 3x4 a line."""

from dataclasses import replace
from pathlib import Path

from edgemap.geometry.camera.intrinsics import Intrinsics
from edgemap.geometry.errors import GeometryError
from edgemap.runtime.frames.errors import CameraError
from edgemap.runtime.frames.faults import FaultKind, note
from edgemap.runtime.frames.reading import read_text
from edgemap.runtime.frames.spatial_poses import attitudes_of, planarise, upright_camera
from edgemap.runtime.frames.trajectory import Trajectory
from edgemap.runtime.inputs.drives.drive import Drive
from edgemap.runtime.inputs.drives.layout import drive_of, one_each, with_depth
from edgemap.runtime.inputs.drives.pictures import first_folder, list_pictures, read_picture
from edgemap.runtime.inputs.drives.pose_files import read_matrices, read_stamps


def read_kitti(folder: Path) -> Drive:
    """Read a KITTI sequence. The world is the first camera's: its y points down, so up is `-y` by default.

    Its mount is a car's. `times.txt`, one stamp in seconds per line, is used where present. Raises CameraError.
    """
    images = list_pictures(first_folder(folder, ("image", "image_2", "images")))
    return _with_poses(drive_of("kitti", folder, images, "-y"), 12, ("times.txt",))


def read_c2w(folder: Path) -> Drive:
    """Read pictures with 4x4 camera-to-world lines, optical camera axes, metres; the world is z-up by default.

    `K.txt`, 3x3 in px, is used where no camera.yaml is. `stamps.txt` or `times.txt` in seconds where present. `depth/`:
    a 16-bit picture of millimetres for each picture, 0 where unknown, registered to it unless `camera.yaml` states its
    camera's pose. Raises CameraError.
    """
    drive = drive_of("c2w", folder, list_pictures(first_folder(folder, ("image", "images"))))
    if drive.intrinsics is None and (folder / "K.txt").is_file():
        drive = replace(drive, intrinsics=_read_k(folder / "K.txt", drive.images[0]))
    return with_depth(_with_poses(drive, 16, ("stamps.txt", "times.txt")))


def _with_poses(drive: Drive, columns: int, times: tuple[str, ...]) -> Drive:
    """The drive with the poses of `poses.txt`, and the stamps of the first of these files. Raises CameraError."""
    path = drive.folder / "poses.txt"
    poses = one_each(path, read_matrices(path, columns), drive)
    if stated := next((drive.folder / name for name in times if (drive.folder / name).is_file()), None):
        drive = replace(drive, stamps_s=one_each(stated, read_stamps(stated), drive))
    stamps = drive.stamps_s
    try:
        truth = Trajectory(stamps, planarise(poses, drive.world_up, "z", drive.mount))
    except CameraError as error:  # the pictures can be driven without
        note(FaultKind.SAMPLES, f"{path}: no true poses: {error}")
        return drive
    attitudes = attitudes_of(stamps, poses, drive.world_up) if drive.kind == "c2w" else None
    full = upright_camera(poses, drive.world_up, drive.mount)
    return replace(drive, truth=truth, attitudes=attitudes, full_poses=full)


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
