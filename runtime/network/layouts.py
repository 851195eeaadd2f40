"""Outputs of detectors as other projects export them: which arrays hold boxes, scores and labels, and in what form."""

from collections.abc import Mapping, Sequence
from functools import cache
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.special import softmax

from edgemap.geometry.arrays import Array
from edgemap.runtime.frames.reading import Strict

Arrays = Mapping[str, NDArray]
Layout = Literal[
    "class columns",
    "class rows",
    "objectness rows",
    "box score label rows",
    "label score box rows",
    "batch box label score rows",
    "bin rows",
    "bin levels",
    "queries",
    "lists",
]
Form = Literal["cxcywh", "xyxy", "yxyx", "cells", "bins", "corner bins"]
# Forms of a layout's boxes, the usual one first.
FORMS: dict[Layout, tuple[Form, ...]] = {
    "class columns": ("cxcywh", "xyxy"),
    "class rows": ("cxcywh", "xyxy"),
    "objectness rows": ("cxcywh", "cells", "xyxy"),
    "box score label rows": ("xyxy", "cxcywh"),
    "label score box rows": ("xyxy",),
    "batch box label score rows": ("xyxy",),
    "bin rows": ("corner bins", "bins"),
    "bin levels": ("bins", "corner bins"),
    "queries": ("cxcywh", "xyxy"),
    "lists": ("xyxy", "yxyx", "cxcywh"),
}
# Columns of the box, the score and the label in rows that have one.
LABELLED: dict[Layout, tuple[slice, int, int]] = {
    "box score label rows": (slice(0, 4), 4, 5),
    "label score box rows": (slice(2, 6), 1, 0),
    "batch box label score rows": (slice(1, 5), 6, 5),
}
STRIDES, BINS = (8, 16, 32, 64), 8  # of PicoDet and NanoDet-Plus; of YOLOX the first three


class Reading(Strict):
    """How a file's outputs are read.

    form: of the boxes; cells: YOLOX's offsets and logarithms of its cells; bins: distances to the sides in bins of the
    distribution focal loss, from the middle or (corner bins) the corner of a cell. share: coordinates are shares of the
    input. activation: of the scores. first: label of the first class.
    """

    layout: Layout
    form: Form
    share: bool = False
    activation: Literal["none", "sigmoid", "softmax"] = "none"
    first: int = 0


def layouts(outputs: Arrays) -> list[Layout]:
    """The layouts that outputs of these shapes may have; the number of classes distinguishes them further."""
    arrays = list(outputs.values())
    floats = [array for array in arrays if array.dtype.kind == "f"]
    bins = [array for array in floats if array.ndim == 3 and array.shape[2] == 4 * BINS]
    if len(bins) > 1 and 2 * len(bins) == len(arrays):
        return ["bin levels"]
    boxes = next((array for array in floats if array.ndim in (2, 3) and array.shape[-1] == 4), None)
    if boxes is not None:
        count = boxes.shape[-2]
        if sum(_is_list(array, count) for array in arrays) >= 2:
            return ["lists"]
        if any(array.ndim == 3 and array.shape[1] == count and array is not boxes for array in floats):
            return ["queries"]
    if len(arrays) == 1 and arrays[0].ndim == 2 and arrays[0].shape[1] in (6, 7):
        seven = arrays[0].shape[1] == 7
        return ["batch box label score rows"] if seven else ["box score label rows", "label score box rows"]
    table = next((array for array in floats if array.ndim == 3 and min(array.shape[1:]) > 4), None)
    if table is None:
        return []
    rows, columns = table.shape[1:]
    if rows < columns:
        return ["class columns"]
    if columns >= 6 and _is_whole(table[0, :, 5]) and in_unit(table[0, :, 4]):
        return ["box score label rows"]
    return ["objectness rows", "class rows", "bin rows"]


def rows_of(
    outputs: Arrays,
    reading: Reading,
    classes: int,
    confidence: float,
    size: tuple[int, int],
    strides: tuple[int, ...] = (),
) -> tuple[Array, Array, NDArray[np.int64]]:
    """Boxes (N, 4) xyxy in px of an input of this size (width, height), their scores and class numbers.

    Only boxes of at least this score are returned. strides: of the cells, those of the form by default. Raises
    ValueError where the cells are none of this input's, or a label has no name.
    """
    geometry, scores, labels = parts(outputs, reading.layout)
    if reading.activation == "softmax":
        scores = softmax(scores, axis=1)[:, :classes]
    elif labels is None and reading.layout != "queries":  # whose class of no object rules a box out
        scores = scores[:, :classes]
    best = (scores.max(axis=1, initial=-np.inf) if labels is None else scores).astype(np.float64)
    if reading.activation == "sigmoid":
        best = sigmoid(best)
    strong = np.flatnonzero(best >= confidence)
    numbers = (scores[strong].argmax(axis=1) if labels is None else labels[strong]).astype(np.int64) - reading.first
    if labels is not None and (last := numbers.max(initial=0)) >= classes:
        raise ValueError(f"a box has the label {last}, and the names are of {classes} classes")
    boxes = _corners(geometry, strong, reading, size, strides)
    known = (numbers >= 0) & (numbers < classes) & np.isfinite(boxes).all(axis=1)
    return boxes[known], best[strong][known], numbers[known]


def sigmoid(x: NDArray) -> NDArray:
    """Logits to probabilities."""
    return 1.0 / (1.0 + np.exp(-np.clip(x, -50.0, 50.0)))


def parts(outputs: Arrays, layout: Layout) -> tuple[NDArray, NDArray, NDArray | None]:
    """Geometry (N, 4) or (N, 32), scores (N,) with labels (N,) where the file has them, else scores (N, C) of the
    classes and of what stands behind them: masks, keypoints, no object."""
    arrays = list(outputs.values())
    if layout.endswith(("rows", "columns")):
        table = next((array for array in arrays if array.ndim == 3), arrays[0])
        table = table.reshape(-1, table.shape[-1])
        if layout in LABELLED:
            box, score, label = LABELLED[layout]
            return table[:, box], table[:, score], table[:, label]
        if layout == "bin rows":
            return table[:, -4 * BINS :], table[:, : -4 * BINS], None
        if layout == "objectness rows":
            return table[:, :4], table[:, 4:5] * table[:, 5:], None
        table = table.T if layout == "class columns" else table
        return table[:, :4], table[:, 4:], None
    if layout == "bin levels":  # the finest level first
        levels = sorted((array[0] for array in arrays), key=len, reverse=True)
        bins = [level for level in levels if level.shape[1] == 4 * BINS]
        return np.concatenate(bins), np.concatenate([level for level in levels if level.shape[1] != 4 * BINS]), None
    boxes = next(array for array in arrays if array.ndim in (2, 3) and array.shape[-1] == 4)
    count = boxes.shape[-2]
    if layout == "queries":
        scores = next(a for a in arrays if a.ndim == 3 and a.shape[1] == count and a is not boxes)
        return boxes.reshape(-1, 4), scores[0], None
    flat = [array.reshape(-1) for array in arrays if _is_list(array, count)]
    labels = next((array for array in flat if array.dtype.kind in "iu"), None)
    if labels is None:
        labels = next(array for array in flat if _is_whole(array) and not in_unit(array))
    scores = next(array for array in flat if array is not labels)
    total = next((int(array.reshape(-1)[0]) for array in arrays if array.size == 1 and count != 1), count)
    return boxes.reshape(-1, 4)[:total], scores[:total], labels[:total]


def _corners(
    geometry: NDArray, rows: NDArray, reading: Reading, size: tuple[int, int], strides_px: tuple[int, ...]
) -> Array:
    """Corners (N, 4) xyxy in px of the input, of the chosen rows of a file's geometry."""
    chosen, form = geometry[rows].astype(np.float64), reading.form
    if form == "cells":
        cells, strides = _cells(strides_px or STRIDES[:3], len(geometry), size)
        centres = (chosen[:, :2] + cells[rows]) * strides[rows, None]
        half = np.exp(np.minimum(chosen[:, 2:], 20.0)) * strides[rows, None] / 2.0
        return np.concatenate([centres - half, centres + half], axis=1)
    if form in ("bins", "corner bins"):
        cells, strides = _cells(strides_px or STRIDES, len(geometry), size)
        sides = softmax(chosen.reshape(len(chosen), 4, BINS), axis=2) @ np.arange(BINS)
        middle = cells[rows] + (0.5 if form == "bins" else 0.0)
        return np.concatenate([middle - sides[:, :2], middle + sides[:, 2:]], axis=1) * strides[rows, None]
    if reading.share:
        chosen = chosen * np.array([size[0], size[1]] * 2 if form != "yxyx" else [size[1], size[0]] * 2)
    if form == "yxyx":
        return chosen[:, [1, 0, 3, 2]]
    if form == "cxcywh":
        return np.concatenate([chosen[:, :2] - chosen[:, 2:] / 2.0, chosen[:, :2] + chosen[:, 2:] / 2.0], axis=1)
    return chosen


@cache
def _cells(strides: Sequence[int], count: int, size: tuple[int, int]) -> tuple[Array, Array]:
    """Column and row (N, 2) and stride (N,) of every cell. Raises ValueError where there are not `count`."""
    grids = [(-(-size[0] // stride), -(-size[1] // stride), stride) for stride in strides]
    if sum(columns * rows for columns, rows, _ in grids) != count:
        raise ValueError(f"{count} boxes are not those of strides {strides}")
    cells = [np.column_stack([np.tile(np.arange(c), r), np.repeat(np.arange(r), c)]) for c, r, _ in grids]
    return np.concatenate(cells).astype(np.float64), np.concatenate([np.full(c * r, float(s)) for c, r, s in grids])


def _is_list(array: NDArray, count: int) -> bool:
    """Whether an array has one value for each of so many boxes."""
    return array.size == count and array.shape[-1:] == (count,)


def _is_whole(values: NDArray) -> bool:
    """Whether all values are whole numbers, as labels are."""
    return bool(len(values)) and bool(np.all(values == np.round(values)))


def in_unit(values: NDArray) -> bool:
    """Whether all values lie in 0 to 1, as probabilities do."""
    return bool(np.all((values >= 0.0) & (values <= 1.0)))
