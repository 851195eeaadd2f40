"""The two truth files of a drive, checked: `objects.json` (true objects) and `boxes.json` (true boxes per picture)."""

from pathlib import Path
from typing import Annotated

import msgspec
import numpy as np
from msgspec import Meta

from edgemap.runtime.frames.errors import CameraError
from edgemap.runtime.frames.reading import Coordinate, Name, Share, Size, decode_json, read_bytes
from edgemap.runtime.inputs.drives.drive import LabelledBoxes

TRUTH_BYTES = 32 << 20
Id = Annotated[int, Meta(ge=-(2**53), le=2**53)] | Name


class ObjectRecord(msgspec.Struct):
    """One object of a room, in the start-pose frame; metres. visible_frames: None where the file does not say."""

    id: Id
    label: Name
    x_m: Coordinate
    y_m: Coordinate
    on_floor: bool = True
    footprint_m: Annotated[list[tuple[Coordinate, Coordinate]], Meta(max_length=1000)] = []
    width_m: Size | None = None
    depth_m: Size | None = None
    height_m: Size | None = None
    visible_frames: Annotated[int, Meta(ge=0, le=2**31)] | None = None


class _Box(msgspec.Struct):
    id: Id
    label: Name
    box: tuple[Coordinate, Coordinate, Coordinate, Coordinate]
    visible: Share = 1.0


class _Objects(msgspec.Struct):
    objects: Annotated[list[ObjectRecord], Meta(max_length=100_000)]


class _Boxes(msgspec.Struct):
    frames: Annotated[list[list[_Box]], Meta(max_length=1_000_000)]


def read_objects(path: Path) -> tuple[ObjectRecord, ...]:
    """Read `objects.json`. Raises CameraError naming the field or object that is wrong, or an id given twice."""
    records = tuple(decode_json(read_bytes(path, TRUTH_BYTES, CameraError), _Objects, path, CameraError).objects)
    seen = set()
    for record in records:
        if record.id in seen:
            raise CameraError(f"{path}: two objects have the id {record.id!r}")
        seen.add(record.id)
    return records


def read_boxes(path: Path) -> tuple[LabelledBoxes, ...]:
    """Read `boxes.json`, one entry per picture. Raises CameraError."""
    frames = []
    known = decode_json(read_bytes(path, TRUTH_BYTES, CameraError), _Boxes, path, CameraError).frames
    for number, frame in enumerate(known):
        boxes = np.array([box.box for box in frame], dtype=np.float64).reshape(-1, 4)
        if np.any(boxes[:, 2:] < boxes[:, :2]):
            raise CameraError(f"{path}: frame {number} has a box whose right or lower edge comes first")
        labels = tuple(box.label for box in frame)
        visible = np.array([box.visible for box in frame], dtype=np.float64)
        frames.append(LabelledBoxes(boxes, labels, visible, tuple(str(box.id) for box in frame)))
    return tuple(frames)
