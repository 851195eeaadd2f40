"""`KIND:DIR` to a `Drive`, one reader per layout, and to pictures with true boxes."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import msgspec
import numpy as np
from numpy.typing import NDArray

from edgemap.runtime.frames.errors import CameraError
from edgemap.runtime.frames.reading import library_path, user_path
from edgemap.runtime.inputs.drives.c2w import read_c2w, read_kitti
from edgemap.runtime.inputs.drives.drive import Drive, LabelledBoxes
from edgemap.runtime.inputs.drives.euroc import read_euroc
from edgemap.runtime.inputs.drives.locobot import read_locobot
from edgemap.runtime.inputs.drives.own import read_own
from edgemap.runtime.inputs.drives.pictures import read_picture, video_frames
from edgemap.runtime.inputs.drives.sensor_csv import read_imu_csv
from edgemap.runtime.inputs.drives.truth import ObjectRecord, read_objects
from edgemap.runtime.inputs.drives.tum import read_tum_drive
from edgemap.runtime.inputs.drives.yolo import read_yolo

READERS: dict[str, Callable[[Path], Drive]] = {
    "kitti": read_kitti,
    "tum": read_tum_drive,
    "c2w": read_c2w,
    "drive": read_own,
    "euroc": read_euroc,
    "locobot": read_locobot,
    "yolo": read_yolo,
}


def open_drive(spec: str) -> Drive:
    """Read the drive `KIND:DIR`, KIND one of `READERS`. Pictures are listed, not decoded.

    `objects.json` and `imu.csv` are read here for every KIND.
    Raises CameraError, one line with the path and the numbers, for an unknown KIND and for anything missing or wrong.
    """
    kind, colon, folder = spec.partition(":")
    if not colon or not folder or kind not in READERS:
        raise CameraError(f"data {spec!r} is not KIND:DIR with KIND one of {', '.join(READERS)}")
    drive = READERS[kind](user_path(folder))
    objects, imu = drive.folder / "objects.json", drive.folder / "imu.csv"
    if objects.is_file():
        drive = replace(drive, objects=tuple(_with_views(record, drive.boxes) for record in read_objects(objects)))
    if drive.imu is None and imu.is_file():
        drive = replace(drive, imu=read_imu_csv(imu))
    return drive


def _with_views(record: ObjectRecord, boxes: Sequence[LabelledBoxes]) -> dict[str, Any]:
    """The object with the number of pictures that show it, counted from the boxes where the file does not state it."""
    if record.visible_frames is None and boxes:
        record.visible_frames = sum(str(record.id) in frame.visible_ids() for frame in boxes)
    return msgspec.structs.asdict(record)


def labelled_pictures(drive: Drive, limit: int | None) -> Iterator[tuple[NDArray[np.uint8], LabelledBoxes]]:
    """The first BGR pictures with their true boxes, in order. Raises CameraError for a damaged picture."""
    pictures = map(read_picture, drive.images)
    if drive.video is not None:
        pictures = (picture for picture, _ in video_frames(cv2.VideoCapture(library_path(drive.video))))
    return zip(pictures, drive.boxes[:limit], strict=False)
