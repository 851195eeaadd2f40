"""Start weights: the numbers of YOLOX-Nano's ONNX file, put in place by order of execution, every shape checked."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
import onnx
import torch
from numpy.typing import NDArray
from onnx import numpy_helper
from torch import Tensor, nn

from edgemap.export.adopt import load_onnx
from edgemap.export.detector.blocks import convolutions
from edgemap.export.detector.network import ANCHORS, SCALE_XY, STRIDES, Head, Nano
from edgemap.export.errors import ExportError
from edgemap.runtime.drives.coco import COCO_NAMES

Pair = tuple[Tensor, Tensor]  # a convolution's weight and bias


def load_yolox(network: Nano, path: Path, names: Sequence[str]) -> None:
    """Fill a network without normalisation from YOLOX-Nano's ONNX file; `names`: COCO's classes to keep, in order.

    The trunk and the branches compute what the file's do. A head's last layers differ: box centres go through
    YOLOv3's sigmoid (equal in value and slope at the cell's centre), sizes are relative to the anchor, and only the
    rows of the kept classes are there. Raises ExportError where the file's convolutions are not YOLOX-Nano's.
    """
    stored = _convolutions(path)
    branches = list(convolutions(network))
    if network.norm:
        raise ExportError(f"{path}: start weights need a network without batch normalisation")
    first = len(branches) + 3 * len(network.heads)
    if len(stored) != first:
        raise ExportError(f"{path}: {len(stored)} convolutions, YOLOX-Nano has {first}")
    queue = iter(stored)
    heads = list(convolutions(network.heads))
    for position, part in enumerate(branches[: len(branches) - len(heads)]):
        weight, bias = next(queue)
        _put(part.conv, (_space_to_depth(weight) if position == 0 else weight, bias), path)
    for head, stride, anchor in zip(network.heads, STRIDES, ANCHORS, strict=True):
        assert isinstance(head, Head)
        _fill_head(head, queue, stride, anchor, names, path)


def _fill_head(
    head: Head, queue: Iterator[Pair], stride: int, anchor: tuple[float, float], names: Sequence[str], path: Path
) -> None:
    for part in (*convolutions(head.stem), *convolutions(head.class_branch)):
        _put(part.conv, next(queue), path)
    weight, bias = next(queue)
    rows = [COCO_NAMES.index(name) for name in names]
    if len(weight) != len(COCO_NAMES):
        raise ExportError(f"{path}: a head of {len(weight)} classes, COCO has {len(COCO_NAMES)}")
    _put(head.classes, (weight[rows], bias[rows]), path)
    for part in convolutions(head.box_branch):
        _put(part.conv, next(queue), path)
    weight, bias = (tensor.clone() for tensor in next(queue))
    # YOLOX: centre = cell + t. Here: cell + 0.5 + s * (sigmoid(t) - 0.5), whose slope at 0 is s / 4.
    weight[:2] *= 4.0 / SCALE_XY
    bias[:2] = (bias[:2] - 0.5) * 4.0 / SCALE_XY
    # YOLOX: size = stride * exp(t). Here: anchor * exp(t).
    bias[2:] -= torch.tensor([math.log(side / stride) for side in anchor])
    _put(head.boxes, (weight, bias), path)
    _put(head.objectness, next(queue), path)


def _put(conv: nn.Conv2d, values: Pair, path: Path) -> None:
    weight, bias = values
    if conv.weight.shape != weight.shape or conv.bias is None or conv.bias.shape != bias.shape:
        raise ExportError(
            f"{path}: a convolution of shape {tuple(weight.shape)} where YOLOX-Nano has {tuple(conv.weight.shape)}"
        )
    with torch.no_grad():
        conv.weight.copy_(weight)
        conv.bias.copy_(bias)


def _convolutions(path: Path) -> list[Pair]:
    model = load_onnx(path)
    constants = {item.name: item for item in model.graph.initializer}
    return [
        (_tensor(constants, node.input[1], path), _tensor(constants, node.input[2], path))
        for node in model.graph.node
        if node.op_type == "Conv" and len(node.input) == 3
    ]


def _tensor(constants: dict[str, onnx.TensorProto], name: str, path: Path) -> Tensor:
    if name not in constants:
        raise ExportError(f"{path}: a convolution's weights {name} are not stored in the file")
    values: NDArray[np.float32] = numpy_helper.to_array(constants[name]).astype(np.float32)
    return torch.from_numpy(values.copy())


def _space_to_depth(weight: Tensor) -> Tensor:
    """(O, 12, 3, 3) on pictures folded 2x2 into channels, to (O, 3, 6, 6) with stride 2 on the picture itself."""
    outputs, channels, rows, columns = weight.shape
    if channels != 12:
        return weight  # its shape is refused by name when it is put in place
    wide = torch.zeros(outputs, 3, 2 * rows, 2 * columns)
    for patch, (down, right) in enumerate(((0, 0), (1, 0), (0, 1), (1, 1))):
        wide[:, :, down::2, right::2] = weight[:, 3 * patch : 3 * patch + 3]
    return wide
