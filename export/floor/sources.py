"""Training data of a floor head: labelled folders, and folders of photographs that a teacher labels first."""

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from edgemap.export.errors import ExportError
from edgemap.runtime.frames.reading import library_path, user_path
from edgemap.runtime.inputs.drives.pictures import list_pictures, read_picture
from edgemap.runtime.inputs.drives.truth import floor_pairs, paired

Pair = tuple[Path, Path]
Teacher = Callable[[NDArray[np.uint8]], NDArray[np.uint8]]


def labelled(spec: str, teacher: Teacher | None, labels: Path) -> list[Pair]:
    """Pictures and label files of `floor:DIR`, `drive:DIR` with floor/, or a plain folder that the teacher labels.

    labels: folder for its shares; existing ones are kept. Raises ExportError or CameraError.
    """
    kind, colon, folder = spec.partition(":")
    if colon and kind in ("floor", "drive"):
        return floor_pairs(user_path(folder))
    source = user_path(spec)
    if not source.is_dir():
        raise ExportError(f"{spec}: expected floor:DIR, drive:DIR with floor/, or a folder of pictures")
    if teacher is None:
        raise ExportError(f"{spec}: pictures without floor labels need a --teacher")
    images = list_pictures(source)
    labels.mkdir(parents=True, exist_ok=True)
    missing = [path for path in images if not (labels / f"{path.stem}.png").is_file()]
    for path in tqdm(missing, unit=" labels", disable=None):
        part = labels / f".{path.stem}.part.png"
        cv2.imwrite(library_path(part), teacher(read_picture(path)))
        part.replace(labels / f"{path.stem}.png")
    return paired(images, labels)
