"""TUM RGB-D: `rgb.txt` (stamp, file) with `groundtruth.txt`, or pictures with `poses.tum`; poses of the CAMERA."""

from dataclasses import replace
from itertools import compress
from pathlib import Path

import numpy as np

from edgemap.geometry.arrays import Array
from edgemap.runtime.frames.errors import CameraError
from edgemap.runtime.frames.reading import read_text
from edgemap.runtime.frames.spatial_poses import attitudes_of, planarise
from edgemap.runtime.frames.trajectory import Trajectory
from edgemap.runtime.inputs.drives.drive import Drive
from edgemap.runtime.inputs.drives.layout import drive_of, one_each, rate_of_stamps
from edgemap.runtime.inputs.drives.pictures import first_folder, list_pictures
from edgemap.runtime.inputs.drives.pose_files import STAMPS, increasing, read_tum_3d

MAX_GAP_S = 0.2  # truth is not interpolated over longer holes (the tracker lost the camera)


def read_tum_drive(folder: Path) -> Drive:
    """Read a TUM folder. Poses are the optical frame's in a world that is z-up unless camera.yaml states another axis.

    With `rgb.txt` the truth is interpolated at the pictures' stamps, and pictures without truth are left out. Without
    it, `poses.tum` has one line per picture. Raises CameraError.
    """
    if (folder / "rgb.txt").is_file():
        drive = _listed_pictures(folder)
    else:
        drive = drive_of("tum", folder, list_pictures(first_folder(folder, ("rgb", "images", "image"))))
        path = folder / "poses.tum"
        stamps, poses = read_tum_3d(path)
        drive = replace(
            drive,
            stamps_s=one_each(path, stamps, drive),
            truth=Trajectory(stamps, planarise(poses, drive.world_up, "z", drive.mount)),
            attitudes=attitudes_of(stamps, poses, drive.world_up),
        )
    return replace(drive, rate_hz=rate_of_stamps(drive.stamps_s) or drive.rate_hz)


def _listed_pictures(folder: Path) -> Drive:
    """Pictures of `rgb.txt`; without those that the truth does not cover."""
    listing, truth_path = folder / "rgb.txt", folder / "groundtruth.txt"
    stamps, names = _listed(listing)
    drive = replace(drive_of("tum", folder, tuple(folder / name for name in names)), stamps_s=stamps)
    if not truth_path.is_file():
        return drive
    truth_stamps, poses = read_tum_3d(truth_path)
    recorded = Trajectory(truth_stamps, planarise(poses, drive.world_up, "z", drive.mount))
    # The truth's stamps around each picture's; at both ends twice the same.
    after = np.searchsorted(truth_stamps, stamps)
    before_s, after_s = truth_stamps[np.maximum(after - 1, 0)], truth_stamps[np.minimum(after, len(truth_stamps) - 1)]
    nearest_s = np.minimum(np.abs(stamps - before_s), np.abs(stamps - after_s))
    known = (after_s - before_s <= MAX_GAP_S) & (nearest_s <= MAX_GAP_S / 2)
    if not known.any():
        raise CameraError(
            f"{truth_path}: covers {truth_stamps[0]:.3f} to {truth_stamps[-1]:.3f} s, "
            f"no picture of {listing} ({stamps[0]:.3f} to {stamps[-1]:.3f} s) lies in it"
        )
    kept = stamps[known]
    return replace(
        drive,
        images=tuple(compress(drive.images, known)),
        stamps_s=kept,
        truth=Trajectory(kept, tuple(recorded.at(stamp, MAX_GAP_S) for stamp in kept.tolist())).from_start(),
        attitudes=attitudes_of(truth_stamps, poses, drive.world_up),
    )


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
