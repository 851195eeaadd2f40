"""KITTI odometry: a folder of pictures (`image/` or `image_2/`) and `poses.txt`, 3x4 per line."""

from pathlib import Path

from edgemap.runtime.drives.drive import Drive
from edgemap.runtime.drives.layout import read_setup, stamps_for
from edgemap.runtime.drives.pictures import first_folder, list_pictures
from edgemap.runtime.drives.planarise import planarise_camera, upright_camera
from edgemap.runtime.drives.pose_files import check_count, read_matrices, trajectory


def read_kitti(folder: Path) -> Drive:
    """Read a KITTI sequence. The world is the first camera's: its y points down, so up is `-y` unless said otherwise.

    `times.txt`, one stamp in seconds per line, is used where present. Raises CameraError.
    """
    pictures_folder = first_folder(folder, ("image", "image_2", "images"))
    images = list_pictures(pictures_folder)
    setup = read_setup(folder, world_up="-y")
    path = folder / "poses.txt"
    poses = read_matrices(path, 12)
    check_count(path, len(poses), len(images), pictures_folder)
    stamps = stamps_for(folder, ("times.txt",), len(images), pictures_folder, setup.rate_hz)
    recorded = poses, setup.world_up, setup.mount
    truth, full = trajectory(path, stamps, planarise_camera(*recorded)), upright_camera(*recorded)
    return Drive(
        "kitti", folder, images, stamps, setup.intrinsics, setup.mount, setup.rate_hz, truth, full_poses=full,
        notes=setup.notes,
    )  # fmt: skip
