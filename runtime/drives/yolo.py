"""YOLO text labels: `images/` and `labels/`, one `class cx cy w h` line per object, relative to the picture."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from edgemap.runtime.drives.coco import COCO_NAMES
from edgemap.runtime.drives.drive import Drive, LabelledBoxes
from edgemap.runtime.drives.layout import read_setup
from edgemap.runtime.drives.pictures import list_pictures, read_picture
from edgemap.runtime.drives.pose_files import check_count, read_text
from edgemap.runtime.drives.truth_json import read_boxes
from edgemap.runtime.errors import CameraError


def read_yolo(folder: Path) -> Drive:
    """Read labelled pictures; class numbers are COCO's 80. A picture without a label file shows no object.

    A `boxes.json` beside them, one entry per picture in order of names, goes before the labels: it also knows what is
    hidden. There is no way between the pictures, so no truth. Raises CameraError.
    """
    images = list_pictures(folder / "images")
    if (folder / "boxes.json").is_file():
        known = read_boxes(folder / "boxes.json")
        check_count(folder / "boxes.json", len(known), len(images), folder / "images")
        return _drive(folder, images, known)
    labels = folder / "labels"
    if not labels.is_dir():
        raise CameraError(f"{labels}: no such folder")
    paths = [labels / f"{image.stem}.txt" for image in images]
    if not any(path.is_file() for path in paths):
        raise CameraError(f"{labels}: no label file for any of the {len(images)} pictures in {folder / 'images'}")
    return _drive(folder, images, tuple(_read_labels(path, image) for path, image in zip(paths, images, strict=True)))


def _drive(folder: Path, images: tuple[Path, ...], boxes: tuple[LabelledBoxes, ...]) -> Drive:
    setup = read_setup(folder, world_up="z")
    stamps = np.arange(len(images)) / setup.rate_hz
    return Drive("yolo", folder, images, stamps, setup.intrinsics, setup.mount, setup.rate_hz, boxes=boxes)


def write_yolo_labels(path: Path, boxes: Sequence[tuple[int, Sequence[float]]], width: int, height: int) -> None:
    """Write one picture's labels: (class number, xyxy in px) each; the picture's size in px makes them relative."""
    lines = []
    for number, (x0, y0, x1, y1) in boxes:
        centre = f"{(x0 + x1) / 2 / width:.6f} {(y0 + y1) / 2 / height:.6f}"
        lines.append(f"{number} {centre} {(x1 - x0) / width:.6f} {(y1 - y0) / height:.6f}\n")
    path.write_text("".join(lines))


def _read_labels(path: Path, image: Path) -> LabelledBoxes:
    rows = []
    if path.is_file():
        for number, line in enumerate(read_text(path).splitlines(), start=1):
            if line.strip():
                rows.append(_row(path, number, line))
    if not rows:
        return LabelledBoxes(np.zeros((0, 4)), ())
    height, width = read_picture(image).shape[:2]
    relative = np.array([row[1:] for row in rows])
    centres, halves = relative[:, :2], relative[:, 2:] / 2
    corners = np.hstack([centres - halves, centres + halves]) * [width, height, width, height]
    return LabelledBoxes(corners, tuple(COCO_NAMES[int(row[0])] for row in rows))


def _row(path: Path, number: int, line: str) -> list[float]:
    try:
        row = [float(word) for word in line.split()]
    except ValueError:
        row = []
    if len(row) != 5 or not all(map(math.isfinite, row)):
        raise CameraError(f"{path}:{number}: expected `class cx cy w h`, found {line.strip()[:60]!r}")
    if row[0] not in range(len(COCO_NAMES)):
        raise CameraError(f"{path}:{number}: class {row[0]:g} is not one of COCO's 0..{len(COCO_NAMES) - 1}")
    if not all(0.0 <= value <= 1.0 for value in row[1:]):
        raise CameraError(f"{path}:{number}: box {row[1:]} is not relative to the picture (0..1)")
    return row
