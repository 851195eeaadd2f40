"""Which cell answers for which true box: simplified optimal transport (SimOTA; Ge et al. 2021, section 2.1)."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from edgemap.export.detector.boxes import Cells, overlap

RADIUS = 2.5  # cells between a cell's centre and the box's, per axis: as far as the decode rule reaches
MOST_CELLS = 10  # of one box
IGNORED_OVERLAP = 0.5
FAR = 1e5


@dataclass(frozen=True)
class Targets:
    """True boxes of a batch, padded: boxes (B, G, 4) xyxy px, labels (B, G), valid and ignored (B, G) bool."""

    boxes: Tensor
    labels: Tensor
    valid: Tensor
    ignored: Tensor


@dataclass(frozen=True)
class Assignment:
    """Per cell (B, N): whether it answers for a box, which of its picture's, their IoU, and whether it is exempt."""

    positive: Tensor
    box: Tensor
    iou: Tensor
    exempt: Tensor


@torch.no_grad()
def assign(rows: Tensor, boxes: Tensor, cells: Cells, targets: Targets) -> Assignment:
    """Give every true box its cheapest cells near its centre, as many as its best overlaps sum up to.

    rows: raw (B, N, 5+C); boxes: decoded (B, N, 4). A cell that two boxes want goes to the cheaper. Cells that are
    nobody's and overlap an ignored box are exempt from the objectness loss.
    """
    iou = overlap(targets.boxes, boxes)
    middle = (targets.boxes[..., :2] + targets.boxes[..., 2:]) / 2.0
    near = ((cells.centres - middle[:, :, None]).abs().amax(-1) < RADIUS * cells.strides) & targets.valid[..., None]
    low = (cells.centres - targets.boxes[:, :, None, :2]).amin(-1)
    high = (targets.boxes[:, :, None, 2:] - cells.centres).amin(-1)
    inside = torch.minimum(low, high) > 0.0
    cost = _class_cost(rows, targets.labels) - 3.0 * torch.log(iou + 1e-8) + FAR * ~(near & inside)
    cost = torch.where(near, cost, torch.inf)
    chosen = _cheapest(cost, torch.where(near, iou, 0.0))
    best = torch.where(chosen, cost, torch.inf).argmin(dim=1)
    positive = chosen.any(dim=1)
    matched = iou.gather(1, best[:, None]).squeeze(1)
    hidden = torch.where(targets.ignored[..., None], iou, 0.0).amax(dim=1) > IGNORED_OVERLAP
    return Assignment(positive, best, matched, hidden & ~positive)


def _class_cost(rows: Tensor, labels: Tensor) -> Tensor:
    """Binary cross entropy of each cell's class scores against each box's label, (B, G, N)."""
    scores = (torch.sigmoid(rows[..., 5:]) * torch.sigmoid(rows[..., 4:5])).sqrt().clamp(1e-6, 1.0 - 1e-6)
    no = -torch.log1p(-scores)
    swap = -torch.log(scores) - no
    wanted = labels[..., None].expand(-1, -1, rows.shape[1])
    return swap.transpose(1, 2).gather(1, wanted) + no.sum(-1)[:, None]


def _cheapest(cost: Tensor, iou: Tensor) -> Tensor:
    """The k cheapest cells of each box, k = the sum of its ten best overlaps, at least one: (B, G, N) bool."""
    most = min(MOST_CELLS, cost.shape[-1])
    wanted = iou.topk(most, dim=-1).values.sum(-1).int().clamp(min=1)
    values, indices = cost.topk(most, dim=-1, largest=False)
    taken = (torch.arange(most) < wanted[..., None]) & torch.isfinite(values)
    return torch.zeros_like(cost, dtype=torch.bool).scatter(-1, indices, taken)
