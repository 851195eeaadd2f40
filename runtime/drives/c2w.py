"""Pictures with camera-to-world poses: `image/` or the folder itself, `poses.txt` with a 4x4 per line, `K.txt`."""

from pathlib import Path

from edgemap.geometry.camera.intrinsics import Intrinsics
from edgemap.geometry.errors import GeometryError
from edgemap.runtime.drives.drive import Drive
from edgemap.runtime.drives.layout import read_setup, stamps_for
from edgemap.runtime.drives.pictures import first_folder, list_pictures, read_picture
from edgemap.runtime.drives.planarise import camera_attitudes, planarise_camera, upright_camera
from edgemap.runtime.drives.pose_files import check_count, read_matrices, trajectory
from edgemap.runtime.errors import CameraError
from edgemap.runtime.reading import read_text

K_BYTES = 4096


def read_c2w(folder: Path) -> Drive:
    """Read pictures with 4x4 camera-to-world lines, optical camera axes, metres; the world is z-up unless said.

    `K.txt`, 3x3 in px, is used where no camera.yaml is. `stamps.txt` or `times.txt` in seconds where present.
    Raises CameraError.
    """
    pictures_folder = first_folder(folder, ("image", "images"))
    images = list_pictures(pictures_folder)
    k_path = folder / "K.txt"
    lens = _read_k(k_path, images[0]) if k_path.is_file() and not (folder / "camera.yaml").is_file() else None
    setup = read_setup(folder, world_up="z", intrinsics=lens)
    path = folder / "poses.txt"
    poses = read_matrices(path, 16)
    check_count(path, len(poses), len(images), pictures_folder)
    stamps = stamps_for(folder, ("stamps.txt", "times.txt"), len(images), pictures_folder, setup.rate_hz)
    recorded = poses, setup.world_up, setup.mount
    truth, full = trajectory(path, stamps, planarise_camera(*recorded)), upright_camera(*recorded)
    return Drive(
        "c2w", folder, images, stamps, setup.intrinsics, setup.mount, setup.rate_hz, truth, full_poses=full,
        attitudes=camera_attitudes(stamps, poses, setup.world_up), notes=setup.notes,
    )  # fmt: skip


def _read_k(path: Path, first_picture: Path) -> Intrinsics:
    height, width = read_picture(first_picture).shape[:2]
    try:
        numbers = [float(word) for word in read_text(path, K_BYTES, CameraError).split()]
        if len(numbers) != 9:
            raise CameraError(f"{path}: {len(numbers)} numbers, expected a 3x3 matrix")
        return Intrinsics(width, height, numbers[0], numbers[4], numbers[2], numbers[5])
    except ValueError:
        raise CameraError(f"{path}: not numbers, expected a 3x3 matrix") from None
    except GeometryError as error:
        raise CameraError(f"{path}: {error}") from None
