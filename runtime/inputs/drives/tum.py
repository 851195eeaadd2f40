"""TUM RGB-D: `rgb.txt` (stamp, file) with `groundtruth.txt`, or pictures with `poses.tum`; poses of the CAMERA."""

from pathlib import Path

import numpy as np

from edgemap.geometry.arrays import Array
from edgemap.geometry.se2 import SE2
from edgemap.runtime.frames.errors import CameraError
from edgemap.runtime.frames.reading import read_text
from edgemap.runtime.frames.spatial_poses import attitudes_of, planarise
from edgemap.runtime.frames.trajectory import AttitudeTrack, Trajectory
from edgemap.runtime.inputs.drives.camera_yaml import Setup, read_setup
from edgemap.runtime.inputs.drives.drive import Drive
from edgemap.runtime.inputs.drives.pictures import first_folder, list_pictures
from edgemap.runtime.inputs.drives.pose_files import STAMPS, check_count, increasing, rate_of_stamps, read_tum_3d

MAX_GAP_S = 0.2  # truth is not interpolated over longer holes (the tracker lost the camera)


def read_tum_drive(folder: Path) -> Drive:
    """Read a TUM folder. Poses are the optical frame's in a world that is z-up unless camera.yaml states another axis.

    With `rgb.txt` the truth is interpolated at the pictures' stamps, and pictures without truth are left out. Without
    it, `poses.tum` has one line per picture. Raises CameraError.
    """
    setup = read_setup(folder, world_up="z")
    if (folder / "rgb.txt").is_file():
        images, stamps, truth, attitudes = _listed_pictures(folder, setup)
    else:
        pictures_folder = first_folder(folder, ("rgb", "images", "image"))
        images = list_pictures(pictures_folder)
        path = folder / "poses.tum"
        stamps, poses = read_tum_3d(path)
        check_count(path, len(stamps), len(images), pictures_folder)
        truth = Trajectory(stamps, planarise(poses, setup.world_up, "z", setup.mount))
        attitudes = attitudes_of(stamps, poses, setup.world_up)
    rate_hz = rate_of_stamps(stamps, setup.rate_hz)
    return Drive("tum", folder, images, stamps, setup.intrinsics, setup.mount, rate_hz, truth, attitudes=attitudes)


def _listed_pictures(
    folder: Path, setup: Setup
) -> tuple[tuple[Path, ...], Array, Trajectory | None, AttitudeTrack | None]:
    """Pictures of `rgb.txt` with stamps, truth and attitudes; without those that the truth does not cover."""
    listing = folder / "rgb.txt"
    stamps, names = _listed(listing)
    images = tuple(folder / name for name in names)
    truth_path = folder / "groundtruth.txt"
    if not truth_path.is_file():
        return images, stamps, None, None
    truth_stamps, poses = read_tum_3d(truth_path)
    recorded = Trajectory(truth_stamps, planarise(poses, setup.world_up, "z", setup.mount))
    known = [i for i, stamp in enumerate(stamps) if _is_covered(truth_stamps, stamp)]
    if not known:
        raise CameraError(
            f"{truth_path}: covers {truth_stamps[0]:.3f} to {truth_stamps[-1]:.3f} s, "
            f"no picture of {listing} ({stamps[0]:.3f} to {stamps[-1]:.3f} s) lies in it"
        )
    poses_at: tuple[SE2, ...] = tuple(recorded.at(float(stamps[i]), MAX_GAP_S) for i in known)
    kept = stamps[known]
    attitudes = attitudes_of(truth_stamps, poses, setup.world_up)
    return tuple(images[i] for i in known), kept, Trajectory(kept, poses_at).from_start(), attitudes


def _listed(path: Path) -> tuple[Array, list[str]]:
    """Stamps (N,) and file names of a file that lists them, one pair a line. Raises CameraError."""
    lines = [line.split(maxsplit=1) for line in read_text(path, CameraError).splitlines()]
    stamps = "\n".join("".join(line[:1]) for line in lines)
    numbers, rows = STAMPS.parse(stamps.encode(), str(path), CameraError)
    names = ["".join(lines[number - 1][1:]).strip() for number in numbers]
    for number, name in zip(numbers, names, strict=True):
        if not name or not name.isprintable():
            raise CameraError(f"{path}:{number}: no file is named after the stamp")
    return increasing(path, numbers, rows), names


def _is_covered(truth_stamps: Array, stamp: float) -> bool:
    after = int(np.searchsorted(truth_stamps, stamp))
    near = truth_stamps[max(after - 1, 0) : after + 1]
    gap = near[-1] - near[0]
    return bool(gap <= MAX_GAP_S and np.abs(near - stamp).min() <= MAX_GAP_S / 2)
