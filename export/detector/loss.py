"""The training losses: of labelled pictures, and of staying close to another network's predictions.

Which cell answers for which true box is simplified optimal transport (SimOTA; Ge et al. 2021, section 2.1). All of it
is dense, masked sums over every cell: no value decides a shape, so a GPU never waits for the processor.
"""

from collections.abc import Callable
from dataclasses import dataclass, fields

import torch
from torch import Tensor
from torch.nn import functional

from edgemap.export.detector.boxes import Rows, generalised_iou, overlap
from edgemap.runtime.network.layouts import BINS

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
    """Per cell (B, N): whether it answers for a box, which of its picture's, and whether it is exempt."""

    positive: Tensor
    box: Tensor
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
    hidden = torch.where(targets.ignored[..., None], iou, 0.0).amax(dim=1) > IGNORED_OVERLAP
    return Assignment(positive, best, hidden & ~positive)


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


# Weights of the parts, and how negatives count where scores are of classes alone, as in PicoDet's own training (Yu et
# al. 2021). Scores with an objectness were trained with plain cross entropy: with that little weight on negatives they
# rise everywhere (yolox-nano, 36 steps: AP50 on photographs of 0.06).
BOX_WEIGHT, BINS_WEIGHT = 2.0, 0.25
SEEN_SCORE = 0.1  # of a cell that counts as seeing something
NEGATIVE_WEIGHT, NEGATIVE_POWER = 0.75, 2.0

Mean = Callable[[Tensor], Tensor]


def detection_loss(
    rows: Rows, targets: Targets, mean: Mean = lambda value: value, least: float = 1.0
) -> tuple[dict[str, Tensor], Assignment]:
    """Rows and truth to `total`, `scores`, `box`, `bins`, each per unit of overlap reached at positive cells.

    Scores: varifocal loss (Zhang et al. 2021) or, of heads with an objectness, cross entropy towards the overlap, times
    the box's certainty where a network predicted it; for a cell without a box, only for classes that this picture's
    labels cover (`Targets.complete`), and not where it is exempt. Box: 1 - GIoU. Bins: distribution focal loss (Li et
    al. 2020), of heads that have them. mean: of a number over all processes that train together. least: lower bound of
    the overlap that losses are divided by. Also returns the assignment.
    """
    found = assign(rows, targets)
    truth = targets.boxes.gather(1, found.box[..., None].expand(-1, -1, 4))
    label = targets.labels.gather(1, found.box)
    iou, overlap = generalised_iou(rows.boxes, truth)
    quality = iou.detach().clamp(min=0.0) * found.positive * targets.certainty.gather(1, found.box)
    count = mean(quality.sum()).clamp(min=least)

    wanted = torch.zeros_like(rows.scores).scatter_(-1, label[..., None], quality[..., None])
    counts = found.positive[..., None] | (targets.complete[:, None] & ~found.exempt[..., None])
    weight = counts.float()
    if rows.bins is not None:
        negative = NEGATIVE_WEIGHT * rows.scores.detach().sigmoid() ** NEGATIVE_POWER
        weight = torch.where(wanted > 0.0, wanted, negative * weight)
    scores = functional.binary_cross_entropy_with_logits(rows.scores, wanted, weight, reduction="sum") / count
    box = ((1.0 - overlap) * quality).sum() / count
    bins = torch.zeros_like(box)
    if rows.bins is not None:
        sides = torch.cat([rows.centres - truth[..., :2], truth[..., 2:] - rows.centres], dim=-1)
        bins = (_focal_bins(rows.bins, sides / rows.strides[:, None]) * quality).sum() / count
    total = scores + BOX_WEIGHT * box + BINS_WEIGHT * bins
    return {"total": total, "scores": scores.detach(), "box": box.detach(), "bins": bins.detach()}, found


def distance_loss(rows: Rows, reference: Rows, kept: Tensor) -> tuple[Tensor, Tensor]:
    """Summed distance of rows to those of a reference network, and the sum of that network's scores. kept: (B, N, C),
    the entries that count. Of scores and bins the Kullback-Leibler divergence; of boxes without bins how far their
    edges moved, strides; both as far as the other network sees anything there.
    """
    probability = reference.scores.sigmoid()
    seen, sure = probability.amax(-1), torch.where(kept, probability, 0.0).amax(-1)
    cross = functional.binary_cross_entropy_with_logits(rows.scores, probability, reduction="none")
    own = functional.binary_cross_entropy_with_logits(reference.scores, probability, reduction="none")
    if rows.bins is None or reference.bins is None:
        moved = ((rows.boxes - reference.boxes) / rows.strides[:, None]).abs().sum(-1)
    else:
        ours, theirs = rows.bins.log_softmax(-1), reference.bins.log_softmax(-1)
        moved = functional.kl_div(ours, theirs, reduction="none", log_target=True).sum((-1, -2))
    return ((cross - own) * kept).sum() + (moved * sure).sum(), torch.where(seen > SEEN_SCORE, seen, 0.0).sum()


def _focal_bins(bins: Tensor, sides: Tensor) -> Tensor:
    """Distribution focal loss of bins (..., 4, 8) towards distances (..., 4) in strides, mean of the four."""
    sides = sides.clamp(0.0, BINS - 1 - 0.01)
    low = sides.long()
    share = (sides - low)[..., None]
    likely = bins.log_softmax(-1)
    both = likely.gather(-1, low[..., None]) * (1.0 - share) + likely.gather(-1, low[..., None] + 1) * share
    return -both.mean((-1, -2))
