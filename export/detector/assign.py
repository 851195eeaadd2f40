"""Which cell answers for which true box: simplified optimal transport (SimOTA; Ge et al. 2021, section 2.1)."""

from dataclasses import dataclass, fields

import torch
from torch import Tensor

from edgemap.export.detector.boxes import Rows, overlap

MAXIMUM_CELLS = 10  # of one box
IGNORED_OVERLAP = 0.5
FAR = 1e5
IOU_COST = 6.0  # of the overlap against the class, as in PicoDet


@dataclass(frozen=True)
class Targets:
    """Target boxes of a batch, padded: boxes (B, G, 4) xyxy px, labels (B, G), valid and ignored (B, G) bool, certainty
    (B, G): 1 for a label, or the score of the network that predicted the box.

    complete: (B, C) bool, the classes that a picture's labels cover fully. kept: (B, C) bool, the classes
    for which training keeps another network's predictions.
    """

    boxes: Tensor
    labels: Tensor
    valid: Tensor
    ignored: Tensor
    complete: Tensor
    kept: Tensor
    certainty: Tensor

    def to(self, device: torch.device) -> "Targets":
        """The same on another device."""
        return Targets(*(getattr(self, field.name).to(device, non_blocking=True) for field in fields(self)))


@dataclass(frozen=True)
class Assignment:
    """Per cell (B, N): whether it answers for a box, which of its picture's, their IoU, and whether it is exempt."""

    positive: Tensor
    box: Tensor
    iou: Tensor
    exempt: Tensor


@torch.no_grad()
def assign(rows: Rows, targets: Targets) -> Assignment:
    """Give every true box its cheapest cells near its centre, as many as its best overlaps sum up to.

    A cell claimed by two boxes goes to the cheaper one. Unassigned cells that overlap an ignored box are exempt from
    the score loss.
    """
    centres, iou = rows.centres, overlap(targets.boxes, rows.boxes)
    middle = (targets.boxes[..., :2] + targets.boxes[..., 2:]) / 2.0
    off = (centres - middle[:, :, None]).abs().amax(-1)
    near = (off <= rows.reach * rows.strides) & targets.valid[..., None]
    low = (centres - targets.boxes[:, :, None, :2]).amin(-1)
    high = (targets.boxes[:, :, None, 2:] - centres).amin(-1)
    inside = torch.minimum(low, high) > 0.0
    cost = _class_cost(rows.scores.sigmoid(), targets.labels, iou) - IOU_COST * torch.log(iou + 1e-8)
    cost = torch.where(near, cost + FAR * ~(near & inside), torch.inf)
    chosen = _cheapest(cost, torch.where(near, iou, 0.0))
    best = torch.where(chosen, cost, torch.inf).argmin(dim=1)
    positive = chosen.any(dim=1)
    matched = iou.gather(1, best[:, None]).squeeze(1)
    hidden = torch.where(targets.ignored[..., None], iou, 0.0).amax(dim=1) > IGNORED_OVERLAP
    return Assignment(positive, best, matched, hidden & ~positive)


def _class_cost(scores: Tensor, labels: Tensor, iou: Tensor) -> Tensor:
    """Cross entropy of cells' scores of each box's class towards their overlap, (B, G, N), times their gap squared."""
    wanted = labels[..., None].expand(-1, -1, scores.shape[1])
    score = scores.transpose(1, 2).gather(1, wanted).clamp(1e-6, 1.0 - 1e-6)
    return -(iou * score.log() + (1.0 - iou) * torch.log1p(-score)) * (iou - score).square()


def _cheapest(cost: Tensor, iou: Tensor) -> Tensor:
    """The k cheapest cells of each box, k = the sum of its ten best overlaps, at least one: (B, G, N) bool."""
    most = min(MAXIMUM_CELLS, cost.shape[-1])
    wanted = iou.topk(most, dim=-1).values.sum(-1).int().clamp(min=1)
    values, indices = cost.topk(most, dim=-1, largest=False)
    taken = (torch.arange(most, device=cost.device) < wanted[..., None]) & torch.isfinite(values)
    return torch.zeros_like(cost, dtype=torch.bool).scatter(-1, indices, taken)
