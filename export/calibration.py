"""Pictures by which int8 numbers are chosen and judged, from a folder."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from edgemap.runtime.inputs.drives.drive import LabelledBoxes
from edgemap.runtime.inputs.drives.pictures import first_folder, list_pictures
from edgemap.runtime.inputs.drives.yolo import read_yolo

MAXIMUM_SHOWN, MAXIMUM_JUDGED = 64, 200  # AP50 changes by 0.002 with another 64; 200 judge a loss of 0.01


@dataclass(frozen=True)
class Calibration:
    """shown: pictures that determine the ranges. judged: other ones for evaluation (a single picture serves both), with
    truth where available.
    """

    folder: Path
    shown: tuple[Path, ...]
    judged: tuple[tuple[Path, LabelledBoxes | None], ...]


def read_calibration(folder: Path) -> Calibration:
    """Pictures of a folder, spread evenly over it; a yolo data folder brings truth along. Raises CameraError."""
    if (folder / "labels").is_dir() or (folder / "boxes.json").is_file():
        drive = read_yolo(folder)
        pictures = list(zip(drive.images, drive.boxes, strict=True))
    else:
        pictures = [(path, None) for path in list_pictures(first_folder(folder, ("images",)))]
    shown = _spread(len(pictures), min(MAXIMUM_SHOWN, (len(pictures) + 1) // 2))
    others = [index for index in range(len(pictures)) if index not in set(shown)] or shown
    judged = [others[index] for index in _spread(len(others), MAXIMUM_JUDGED)]
    return Calibration(folder, tuple(pictures[i][0] for i in shown), tuple(pictures[i] for i in judged))


def _spread(count: int, wanted: int) -> list[int]:
    return np.linspace(0, count - 1, min(count, wanted)).astype(int).tolist()
