"""The two truth files of a drive, checked: `objects.json` (what stands where) and `boxes.json` (what is seen where)."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import TypeVar

import msgspec
import numpy as np

from edgemap.runtime.drives.drive import LabelledBoxes
from edgemap.runtime.drives.pose_files import read_text
from edgemap.runtime.errors import CameraError

T = TypeVar("T")


@dataclass
class ObjectRecord:
    """One object of a room, in the start-pose frame; metres. visible_frames: None where the file does not say."""

    id: str | int
    label: str
    x_m: float
    y_m: float
    on_floor: bool = True
    footprint_m: list[tuple[float, float]] = field(default_factory=list)
    width_m: float | None = None
    depth_m: float | None = None
    height_m: float | None = None
    visible_frames: int | None = None


@dataclass
class _Box:
    id: str | int
    label: str
    box: tuple[float, float, float, float]
    visible: float = 1.0


@dataclass
class _Objects:
    objects: list[ObjectRecord]


@dataclass
class _Boxes:
    frames: list[list[_Box]]


def read_objects(path: Path) -> tuple[ObjectRecord, ...]:
    """Read `objects.json`. Raises CameraError naming the field or object that is wrong, or an id given twice."""
    records = tuple(_decode(path, _Objects).objects)
    seen = set()
    for record in records:
        if not (math.isfinite(record.x_m) and math.isfinite(record.y_m)):
            raise CameraError(f"{path}: object {record.id!r} stands at ({record.x_m}, {record.y_m}) m")
        if record.id in seen:
            raise CameraError(f"{path}: two objects have the id {record.id!r}")
        seen.add(record.id)
    return records


def read_boxes(path: Path) -> tuple[LabelledBoxes, ...]:
    """Read `boxes.json`, one entry per picture. Raises CameraError."""
    frames = []
    for number, frame in enumerate(_decode(path, _Boxes).frames):
        boxes = np.array([box.box for box in frame], dtype=np.float64).reshape(-1, 4)
        if np.any(boxes[:, 2:] < boxes[:, :2]):
            raise CameraError(f"{path}: frame {number} has a box whose right or lower edge comes first")
        labels = tuple(box.label for box in frame)
        visible = np.array([box.visible for box in frame], dtype=np.float64)
        frames.append(LabelledBoxes(boxes, labels, visible, tuple(str(box.id) for box in frame)))
    return tuple(frames)


def _decode(path: Path, record: type[T]) -> T:
    try:
        return msgspec.json.decode(read_text(path), type=record)
    except msgspec.DecodeError as error:
        raise CameraError(f"{path}: {error}") from None
