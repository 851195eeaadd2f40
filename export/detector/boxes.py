"""Scores and boxes from the raw outputs of each decode rule, in torch with gradients; overlap of boxes."""

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from edgemap.runtime.network.layouts import BINS
from edgemap.runtime.network.manifest import DetectorSpec, HeadSpec

RADIUS = 2.5  # greatest distance of a box's centre from the cell's, in cells per axis


@dataclass(frozen=True)
class Rows:
    """Predictions of all cells of all heads, one row each (N rows; a cell with three anchors has three).

    scores: (B, N, C) logits of the score by which the runtime ranks: objectness times class probability where there is
    an objectness. boxes: (B, N, 4) xyxy, px of the input. bins: (B, N, 4, 8) logits of the sides, of `dfl` heads alone.
    centres (N, 2) and strides (N,) of the cells, px; reach (N,): greatest distance of a box's
    centre from the cell's, in cells.
    """

    scores: Tensor
    boxes: Tensor
    bins: Tensor | None
    centres: Tensor
    strides: Tensor
    reach: Tensor


def read_heads(outputs: Sequence[Tensor], detector: DetectorSpec, size: tuple[int, int]) -> Rows:
    """Rows of a batch by the contract's decode rule. size: (height, width) of its pictures, px."""
    read = {"yolov3": _yolov3, "yolox": _yolox, "dfl": _dfl}[detector.decode]
    parts = [read(output.float(), head, size) for output, head in zip(outputs, detector.heads, strict=True)]
    bins = [part.bins for part in parts if part.bins is not None]
    scores, boxes = (torch.cat([getattr(part, name) for part in parts], dim=1) for name in ("scores", "boxes"))
    cells = (torch.cat([getattr(part, name) for part in parts]) for name in ("centres", "strides", "reach"))
    return Rows(scores, boxes, torch.cat(bins, dim=1) if bins else None, *cells)


def _yolov3(output: Tensor, head: HeadSpec, size: tuple[int, int]) -> Rows:
    """Logits (B, A*(5+C), H, W): x, y, w, h, objectness, classes of each anchor."""
    anchors = torch.tensor(head.anchors, device=output.device)
    centres, strides = _grid(output.shape[2:], size, output.device)
    rows = output.unflatten(1, (len(anchors), -1)).flatten(3).transpose(2, 3).flatten(1, 2)
    centres, strides = centres.repeat(len(anchors), 1), strides.repeat(len(anchors))
    sides = torch.exp(rows[..., 2:4].clamp(max=6.0)) * anchors.repeat_interleave(len(centres) // len(anchors), dim=0)
    middle = centres + (torch.sigmoid(rows[..., :2]) - 0.5) * head.scale_xy * strides[:, None]
    reach = torch.full_like(strides, min(RADIUS, head.scale_xy / 2.0))
    return Rows(_joint(rows[..., 4:5], rows[..., 5:]), _boxes(middle, sides), None, centres, strides, reach)


def _yolox(output: Tensor, head: HeadSpec, size: tuple[int, int]) -> Rows:
    """Rows (B, N, 5+C), stride by stride; objectness and classes are probabilities already."""
    grids = [_grid((size[0] // s, size[1] // s), size, output.device) for s in head.strides]
    centres, strides = (torch.cat(column) for column in zip(*grids, strict=True))
    logits = torch.logit(output[..., 4:], eps=1e-6)
    # YOLOX counts from a cell's corner.
    middle = centres + (output[..., :2] - 0.5) * strides[:, None]
    sides = torch.exp(output[..., 2:4].clamp(max=6.0)) * strides[:, None]
    reach = torch.full_like(strides, RADIUS)
    return Rows(_joint(logits[..., :1], logits[..., 1:]), _boxes(middle, sides), None, centres, strides, reach)


def _dfl(output: Tensor, head: HeadSpec, size: tuple[int, int]) -> Rows:
    """Logits (B, C+32, H, W): classes, then eight bins of each of left, top, right, bottom."""
    height, width = output.shape[2:]
    size = height * head.strides[0], width * head.strides[0]  # 416 px are 7 cells of stride 64
    centres, strides = _grid((height, width), size, output.device)
    rows = output.flatten(2).transpose(1, 2)
    classes = rows.shape[-1] - 4 * BINS
    bins = rows[..., classes:].unflatten(-1, (4, BINS))
    far = (bins.softmax(-1) @ torch.arange(BINS, dtype=bins.dtype, device=bins.device)) * strides[:, None]
    boxes = torch.cat([centres - far[..., :2], centres + far[..., 2:]], dim=-1)
    return Rows(rows[..., :classes], boxes, bins, centres, strides, torch.full_like(strides, RADIUS))


def _grid(cells: Sequence[int], size: tuple[int, int], device: torch.device) -> tuple[Tensor, Tensor]:
    """Centres (H*W, 2) of the cells of a picture of that (height, width), px, row by row, and their stride (H*W,)."""
    high, wide = size[0] / cells[0], size[1] / cells[1]
    rows, columns = (torch.arange(count, dtype=torch.float32, device=device) + 0.5 for count in cells)
    grid = torch.stack(torch.meshgrid(columns * wide, rows * high, indexing="xy"), dim=-1).reshape(-1, 2)
    return grid, torch.full((len(grid),), wide, device=device)


def _joint(objectness: Tensor, classes: Tensor) -> Tensor:
    """The logit of sigmoid(o) * sigmoid(c): 1/p - 1 = exp(-o) + exp(-c) + exp(-o - c)."""
    return -torch.logaddexp(-objectness - classes, torch.logaddexp(-objectness, -classes))


def _boxes(middle: Tensor, sides: Tensor) -> Tensor:
    return torch.cat([middle - sides / 2.0, middle + sides / 2.0], dim=-1)


def overlap(a: Tensor, b: Tensor) -> Tensor:
    """IoU of boxes (..., N, 4) and (..., M, 4), shape (..., N, M)."""
    common, union = _shared(a[..., :, None, :], b[..., None, :, :])
    return common / union


def generalised_iou(a: Tensor, b: Tensor) -> tuple[Tensor, Tensor]:
    """IoU and GIoU (Rezatofighi et al. 2019) of boxes paired one by one, (..., 4) each."""
    common, union = _shared(a, b)
    hull = _area(torch.minimum(a[..., :2], b[..., :2]), torch.maximum(a[..., 2:], b[..., 2:])).clamp(min=1e-6)
    iou = common / union
    return iou, iou - (hull - union) / hull


def _shared(a: Tensor, b: Tensor) -> tuple[Tensor, Tensor]:
    """Areas of intersection and union of boxes paired one by one."""
    common = _area(torch.maximum(a[..., :2], b[..., :2]), torch.minimum(a[..., 2:], b[..., 2:]))
    union = _area(a[..., :2], a[..., 2:]) + _area(b[..., :2], b[..., 2:]) - common
    return common, union.clamp(min=1e-6)


def _area(low: Tensor, high: Tensor) -> Tensor:
    return (high - low).clamp(min=0.0).prod(-1)
