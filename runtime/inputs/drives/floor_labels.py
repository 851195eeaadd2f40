"""Pictures with true floor labels: `images/` and, for some or all of them, `floor/NAME.png`."""

from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from edgemap.runtime.frames.errors import CameraError
from edgemap.runtime.frames.reading import read_bytes
from edgemap.runtime.inputs.drives.pictures import PICTURE_BYTES, decoded, list_pictures

OTHER, FLOOR, WALL, UNKNOWN = 0, 1, 2, 255


def floor_pairs(folder: Path) -> list[tuple[Path, Path]]:
    """Pairs of a picture in `folder/images` and its labels `folder/floor/NAME.png`, in order.

    Raises CameraError where there are no labels.
    """
    return paired(list_pictures(folder / "images"), folder / "floor")


def paired(images: Sequence[Path], labels: Path) -> list[tuple[Path, Path]]:
    """Pictures with the labels of the same name. Raises CameraError where none has any."""
    pairs = [(path, labels / f"{path.stem}.png") for path in images]
    pairs = [pair for pair in pairs if pair[1].is_file()]
    if not pairs:
        raise CameraError(f"{labels}: no floor labels NAME.png for {len(images)} pictures")
    return pairs


def read_floor_labels(path: Path, size: tuple[int, int]) -> NDArray[np.uint8]:
    """Labels (H, W) of a picture of that size, (width, height): 1 floor, 2 wall, 0 other, 255 unknown.

    Raises CameraError where the file is missing or damaged, of another size, or holds other numbers.
    """
    data = decoded(read_bytes(path, PICTURE_BYTES, CameraError), str(path), cv2.IMREAD_UNCHANGED)
    if data is None or data.ndim != 2 or data.dtype != np.uint8:
        raise CameraError(f"{path}: expected floor labels of one channel of 8 bits")
    if (data.shape[1], data.shape[0]) != size:
        raise CameraError(f"{path}: {data.shape[1]}x{data.shape[0]} px, its picture has {size[0]}x{size[1]}")
    odd = sorted(set(np.unique(data).tolist()) - {OTHER, FLOOR, WALL, UNKNOWN})
    if odd:
        raise CameraError(f"{path}: holds {odd[0]}, expected 1 floor, 2 wall, 0 other, 255 unknown")
    return np.asarray(data, dtype=np.uint8)
