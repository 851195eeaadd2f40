"""The training losses: of labelled pictures, and of staying close to another network's predictions.

All of it is dense, masked sums over every cell: no value decides a shape, so a GPU never waits for the processor.
"""

from collections.abc import Callable

import torch
from torch import Tensor
from torch.nn import functional

from edgemap.export.detector.assign import Assignment, Targets, assign
from edgemap.export.detector.boxes import Rows, generalised_iou
from edgemap.runtime.network.decode import DFL_BINS

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
    sides = sides.clamp(0.0, DFL_BINS - 1 - 0.01)
    low = sides.long()
    share = (sides - low)[..., None]
    likely = bins.log_softmax(-1)
    return -(likely.gather(-1, low[..., None]) * (1.0 - share) + likely.gather(-1, low[..., None] + 1) * share).mean(
        (-1, -2)
    )
