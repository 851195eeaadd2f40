"""Raw heads to boxes inside torch, with gradients; overlap of boxes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from edgemap.export.detector.network import ANCHORS, SCALE_XY, STRIDES


@dataclass(frozen=True)
class Cells:
    """All cells of all strides in one row, finest first: centre (N, 2) and stride (N,), px."""

    centres: Tensor
    strides: Tensor


def cells_of(heads: Sequence[Tensor]) -> Cells:
    """The cells that raw heads (B, 5+C, H, W) are about."""
    centres, strides = [], []
    for head, stride in zip(heads, STRIDES, strict=True):
        rows, columns = torch.meshgrid(*(torch.arange(n, dtype=torch.float32) for n in head.shape[2:]), indexing="ij")
        centres.append((torch.stack([columns, rows], dim=-1).reshape(-1, 2) + 0.5) * stride)
        strides.append(torch.full((head.shape[2] * head.shape[3],), float(stride)))
    return Cells(torch.cat(centres), torch.cat(strides))


def flatten(heads: Sequence[Tensor]) -> Tensor:
    """Raw heads to rows (B, N, 5+C)."""
    return torch.cat([head.flatten(2) for head in heads], dim=2).transpose(1, 2)


def decode(rows: Tensor, cells: Cells) -> Tensor:
    """Boxes (B, N, 4) xyxy in input px from raw rows (B, N, 5+C): the rule `yolov3` of the runtime."""
    counts = [int((cells.strides == stride).sum()) for stride in STRIDES]
    anchors = torch.cat([torch.tensor(a).expand(n, 2) for a, n in zip(ANCHORS, counts, strict=True)])
    offset = (torch.sigmoid(rows[..., :2]) - 0.5) * SCALE_XY
    centres = cells.centres + offset * cells.strides[:, None]
    halves = torch.exp(rows[..., 2:4].clamp(max=6.0)) * anchors / 2.0
    return torch.cat([centres - halves, centres + halves], dim=-1)


def overlap(a: Tensor, b: Tensor) -> Tensor:
    """IoU of boxes (..., N, 4) and (..., M, 4), shape (..., N, M)."""
    low = torch.maximum(a[..., :, None, :2], b[..., None, :, :2])
    high = torch.minimum(a[..., :, None, 2:], b[..., None, :, 2:])
    common = (high - low).clamp(min=0.0).prod(-1)
    return common / (_area(a)[..., :, None] + _area(b)[..., None, :] - common).clamp(min=1e-6)


def generalised_iou(a: Tensor, b: Tensor) -> tuple[Tensor, Tensor]:
    """IoU and GIoU (Rezatofighi et al. 2019) of boxes paired row by row, (N, 4) each."""
    common = (torch.minimum(a[:, 2:], b[:, 2:]) - torch.maximum(a[:, :2], b[:, :2])).clamp(min=0.0).prod(-1)
    union = (_area(a) + _area(b) - common).clamp(min=1e-6)
    hull = (torch.maximum(a[:, 2:], b[:, 2:]) - torch.minimum(a[:, :2], b[:, :2])).prod(-1).clamp(min=1e-6)
    iou = common / union
    return iou, iou - (hull - union) / hull


def _area(boxes: Tensor) -> Tensor:
    return (boxes[..., 2:] - boxes[..., :2]).clamp(min=0.0).prod(-1)
