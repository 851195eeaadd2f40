"""YOLO text labels: `images/` and `labels/`, one `class cx cy w h` line per object, relative to the picture.

With a sixth column, the score, they are pseudo-labels of a network.
"""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from edgemap.runtime.frames.class_names import COCO_NAMES, read_class_names
from edgemap.runtime.frames.errors import CameraError
from edgemap.runtime.frames.reading import read_bytes
from edgemap.runtime.frames.tables import Column, NumberTable, columns
from edgemap.runtime.inputs.drives.drive import Drive, LabelledBoxes
from edgemap.runtime.inputs.drives.layout import drive_of, one_each
from edgemap.runtime.inputs.drives.pictures import list_pictures, read_picture
from edgemap.runtime.inputs.drives.truth import read_boxes

LABEL_SCORE = 0.45  # of a predicted box that is a label; from DOUBT_SCORE on it is neither object nor background
DOUBT_SCORE = 0.2


def label_table(names: Sequence[str], scored: bool = False) -> NumberTable:
    """A label file's lines: the number of one of these classes, centre and sides, and perhaps the score."""
    fields = "cx cy w h score" if scored else "cx cy w h"
    return NumberTable((Column("class", 0.0, len(names) - 1.0), *columns(fields, 0.0, 1.0)))


def read_yolo(folder: Path) -> Drive:
    """Read labelled pictures; class numbers are those of `classes.txt` or `data.yaml`, of COCO where there is neither.

    `classes.txt`, a name per line, lies next to `images/` or in `labels/`, where labelling tools write it; `data.yaml`
    lies next to `images/` or in the folder above, as Ultralytics and Roboflow have it. A picture without a label file
    shows no object. A `boxes.json`, one entry per picture in order of names, takes precedence: it also has the
    visibility. The pictures have no poses. Raises CameraError.
    """
    drive = drive_of("yolo", folder, list_pictures(folder / "images"))
    known, labels = folder / "boxes.json", folder / "labels"
    if known.is_file():
        return replace(drive, boxes=one_each(known, read_boxes(known), drive))
    paths = [labels / f"{image.stem}.txt" for image in drive.images]
    if not any(path.is_file() for path in paths):
        raise CameraError(f"{labels}: no label file for any of the {len(paths)} pictures in {folder / 'images'}")
    described = (folder / "classes.txt", labels / "classes.txt", folder / "data.yaml", folder.parent / "data.yaml")
    stated = next((path for path in described if path.is_file()), None)
    names = COCO_NAMES if stated is None else read_class_names(stated, CameraError)
    return replace(drive, boxes=tuple(map(partial(_read_labels, names), paths, drive.images)))


def write_yolo_labels(path: Path, boxes: Sequence[tuple[int, Sequence[float]]], width: int, height: int) -> None:
    """Write one picture's labels: (class number, xyxy in px) each; the picture's size in px makes them relative."""
    lines = []
    for number, (x0, y0, x1, y1) in boxes:
        centre = f"{(x0 + x1) / 2 / width:.6f} {(y0 + y1) / 2 / height:.6f}"
        lines.append(f"{number} {centre} {(x1 - x0) / width:.6f} {(y1 - y0) / height:.6f}\n")
    path.write_text("".join(lines))


def _read_labels(names: tuple[str, ...], path: Path, image: Path) -> LabelledBoxes:
    data = read_bytes(path, CameraError) if path.is_file() else b""
    if not data.strip():
        return LabelledBoxes(np.zeros((0, 4)), ())
    scored = len(data.split(b"\n", 1)[0].split()) == 6
    numbers, rows = label_table(names, scored).parse(data, str(path), CameraError)
    classes = rows[:, 0].astype(np.int64)
    if len(odd := np.flatnonzero(classes != rows[:, 0])):
        raise CameraError(f"{path}:{numbers[odd[0]]}: class {rows[odd[0], 0]:g} is not a whole number")
    height, width = read_picture(image).shape[:2]
    centres, halves = rows[:, 1:3], rows[:, 3:5] / 2
    corners = np.hstack([centres - halves, centres + halves]) * [width, height, width, height]
    labels = tuple(names[number] for number in classes)
    return predicted_boxes(corners, labels, rows[:, 5]) if scored else LabelledBoxes(corners, labels)


def predicted_boxes(boxes: NDArray[np.float64], labels: Sequence[str], scores: NDArray[np.float64]) -> LabelledBoxes:
    """A network's detections as pseudo-labels: confident boxes, and uncertain ones with a visibility of 0."""
    rows = np.flatnonzero(scores >= DOUBT_SCORE)
    visible = (scores[rows] >= LABEL_SCORE).astype(np.float64)
    return LabelledBoxes(boxes[rows], tuple(labels[int(row)] for row in rows), visible, scores=scores[rows])
