"""Truth of a drive: objects.json, boxes.json, floor_plan.json and floor labels."""

from collections import Counter
from collections.abc import Sequence
from enum import IntEnum
from pathlib import Path
from typing import Annotated

import cv2
import msgspec
import numpy as np
from msgspec import Meta
from numpy.typing import NDArray

from edgemap.runtime.frames.errors import CameraError
from edgemap.runtime.frames.reading import Coordinate, Name, Share, Size, decode_json, read_bytes
from edgemap.runtime.inputs.drives.drive import LabelledBoxes
from edgemap.runtime.inputs.drives.pictures import decoded, list_pictures

Id = Annotated[int, Meta(ge=-(2**53), le=2**53)] | Name


class ObjectRecord(msgspec.Struct):
    """One object of a room, in the start-pose frame; metres. visible_frames: None where the file states none."""

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
    """Read `objects.json`. Raises CameraError naming the field or object that is wrong, or a repeated id."""
    records = tuple(decode_json(read_bytes(path, CameraError), _Objects, path, CameraError).objects)
    for identity, count in Counter(record.id for record in records).items():
        if count > 1:
            raise CameraError(f"{path}: two objects have the id {identity!r}")
    return records


def read_boxes(path: Path) -> tuple[LabelledBoxes, ...]:
    """Read `boxes.json`, one entry per picture. Raises CameraError."""
    frames = []
    known = decode_json(read_bytes(path, CameraError), _Boxes, path, CameraError).frames
    for number, frame in enumerate(known):
        boxes = np.array([box.box for box in frame], dtype=np.float64).reshape(-1, 4)
        if np.any(boxes[:, 2:] < boxes[:, :2]):
            raise CameraError(f"{path}: frame {number} has a box whose right or lower edge comes first")
        labels = tuple(box.label for box in frame)
        visible = np.array([box.visible for box in frame], dtype=np.float64)
        frames.append(LabelledBoxes(boxes, labels, visible, tuple(str(box.id) for box in frame)))
    return tuple(frames)


PLAN_NAME, PLAN_FORMAT = "floor_plan.json", "edgemap.floor_plan/1"
Corners = Annotated[list[tuple[Coordinate, Coordinate]], Meta(min_length=3, max_length=1000)]


class Area(msgspec.Struct):
    """A polygon of the floor, start-pose frame, metres. kind: of a room."""

    corners_m: Corners
    kind: Annotated[str, Meta(max_length=200)] = ""


class Footprint(msgspec.Struct):
    """The footprint of an object on or above the floor, from low_m to high_m above it."""

    corners_m: Corners
    low_m: Coordinate = 0.0
    high_m: Coordinate = 1.0
    label: Annotated[str, Meta(max_length=200)] = ""


class FloorPlan(msgspec.Struct):
    """True floor plan of a home. Walls are solid; rooms and doorways are floor outside of walls and footprints."""

    format: str
    walls: Annotated[list[Area], Meta(max_length=10_000)]
    rooms: Annotated[list[Area], Meta(max_length=10_000)]
    doorways: Annotated[list[Area], Meta(max_length=10_000)] = []
    footprints: Annotated[list[Footprint], Meta(max_length=10_000)] = []


def read_floor_plan(folder: Path) -> FloorPlan | None:
    """The floor plan in a drive's folder; None where there is none. Raises CameraError."""
    path = folder / PLAN_NAME
    if not path.is_file():
        return None
    plan = decode_json(read_bytes(path, CameraError), FloorPlan, path, CameraError)
    if plan.format != PLAN_FORMAT:
        raise CameraError(f"{path}: not an {PLAN_FORMAT} document")
    return plan


class FloorLabel(IntEnum):
    """Label of a picture's pixel."""

    OTHER = 0
    FLOOR = 1
    WALL = 2
    UNKNOWN = 255


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
    data = decoded(read_bytes(path, CameraError), str(path), cv2.IMREAD_UNCHANGED)
    if data is None or data.ndim != 2 or data.dtype != np.uint8:
        raise CameraError(f"{path}: expected floor labels of one channel of 8 bits")
    if (data.shape[1], data.shape[0]) != size:
        raise CameraError(f"{path}: {data.shape[1]}x{data.shape[0]} px, its picture has {size[0]}x{size[1]}")
    odd = sorted(set(np.unique(data).tolist()) - set(FloorLabel))
    if odd:
        raise CameraError(f"{path}: holds {odd[0]}, expected 1 floor, 2 wall, 0 other, 255 unknown")
    return np.asarray(data, dtype=np.uint8)
