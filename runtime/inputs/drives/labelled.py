"""Pictures with true boxes, one by one, from any KIND that has them."""

from collections.abc import Iterator

import cv2
import numpy as np
from numpy.typing import NDArray

from edgemap.runtime.frames.errors import CameraError
from edgemap.runtime.frames.reading import library_path
from edgemap.runtime.inputs.drives.drive import Drive, LabelledBoxes
from edgemap.runtime.inputs.drives.open import open_drive
from edgemap.runtime.inputs.drives.pictures import read_picture


class LabelledPictures:
    """The first `limit` pictures of a drive with their true boxes: iterate for (BGR picture, LabelledBoxes)."""

    def __init__(self, drive: Drive, limit: int | None = None) -> None:
        self._drive = drive
        self._boxes = drive.boxes[:limit]

    def __len__(self) -> int:
        """How many pictures there are."""
        return len(self._boxes)

    def __iter__(self) -> Iterator[tuple[NDArray[np.uint8], LabelledBoxes]]:
        """In order, each picture read when it is due. Raises CameraError for a damaged one."""
        pictures = map(read_picture, self._drive.images) if self._drive.images else self._decoded()
        yield from zip(pictures, self._boxes, strict=False)

    def _decoded(self) -> Iterator[NDArray[np.uint8]]:
        video = cv2.VideoCapture(library_path(self._drive.video or ""))
        while True:
            good, picture = video.read()
            if not good:
                return
            yield np.asarray(picture, dtype=np.uint8)


def labelled_pictures(spec: str, limit: int | None = None) -> LabelledPictures:
    """The labelled pictures of `KIND:DIR`. Raises CameraError where that holds no true boxes."""
    drive = open_drive(spec)
    if not drive.boxes:
        raise CameraError(f"{spec}: no true boxes in it (yolo labels, or boxes.json beside a drive)")
    return LabelledPictures(drive, limit)
