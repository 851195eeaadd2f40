"""The training loss: overlap of boxes, objectness and classes of a batch."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from torch import Tensor
from torch.nn import functional

from edgemap.export.detector.assign import Targets, assign
from edgemap.export.detector.boxes import cells_of, decode, flatten, generalised_iou

BOX_WEIGHT = 5.0


def detection_loss(
    heads: Sequence[Tensor], targets: Targets, mean: Callable[[Tensor], Tensor] = lambda value: value
) -> dict[str, Tensor]:
    """Raw heads and truth to `total`, `box`, `objectness`, `classes`, each per positive cell.

    Box: 1 - GIoU. Objectness: binary cross entropy over all cells but the exempt. Classes: binary cross entropy at
    positive cells towards the overlap reached (as YOLOX). mean: of a number over all processes that train together.
    """
    rows = flatten(heads)
    cells = cells_of(heads)
    boxes = decode(rows, cells)
    found = assign(rows.detach(), boxes.detach(), cells, targets)
    count = mean(found.positive.sum().float()).clamp(min=1.0)
    picture, cell = found.positive.nonzero(as_tuple=True)
    truth = found.box[picture, cell]
    _, overlap = generalised_iou(boxes[picture, cell], targets.boxes[picture, truth])
    box = (1.0 - overlap).sum() / count
    presence = functional.binary_cross_entropy_with_logits(
        rows[..., 4], found.positive.float(), reduction="none", weight=(~found.exempt).float()
    )
    objectness = presence.sum() / count
    wanted = functional.one_hot(targets.labels[picture, truth], rows.shape[-1] - 5) * found.iou[picture, cell, None]
    classes = (
        functional.binary_cross_entropy_with_logits(rows[picture, cell, 5:], wanted.float(), reduction="sum") / count
    )
    total = BOX_WEIGHT * box + objectness + classes
    return {"total": total, "box": box.detach(), "objectness": objectness.detach(), "classes": classes.detach()}
