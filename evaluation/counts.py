"""Detection counts of the paper's Table 2: detected, false, and missed."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from edgemap.evaluation.detection import ScoredPicture
from edgemap.geometry.objects.visibility import iou

SAME_IOU = 0.5
INSIDE_SHARE = 0.5  # of a detection, within a true box that nobody is asked for


@dataclass(frozen=True, slots=True)
class Counts:
    """true: boxes to detect. found: detected ones of these. false: false positives. Missed is true minus found."""

    true: int = 0
    found: int = 0
    false: int = 0

    @property
    def missed(self) -> int:
        """True boxes that no detection belongs to."""
        return self.true - self.found

    def __add__(self, other: "Counts") -> "Counts":
        return Counts(self.true + other.true, self.found + other.found, self.false + other.false)


def count_detections(pictures: Iterable[ScoredPicture], label: int) -> Counts:
    """Match the detections of one class picture by picture, best score first, one to one, at IoU 0.5 or more.

    A detection of an ignored true box, or one that lies in it by more than half, is ignored.
    """
    return sum((_count(picture, label) for picture in pictures), Counts())


def _count(picture: ScoredPicture, label: int) -> Counts:
    ignored = np.zeros(len(picture.true_boxes), dtype=bool) if picture.ignored is None else picture.ignored
    mine = picture.true_labels == label
    asked, others = picture.true_boxes[mine & ~ignored], picture.true_boxes[mine & ignored]
    free = np.ones(len(asked), dtype=bool)
    false = 0
    detected = picture.boxes[picture.labels == label]
    for box in detected[np.argsort(-picture.scores[picture.labels == label], kind="stable")]:
        overlaps = np.where(free, iou(box, asked), 0.0)
        if len(asked) and overlaps.max() >= SAME_IOU:
            free[overlaps.argmax()] = False
        elif not _excused(box, others):
            false += 1
    return Counts(len(asked), int((~free).sum()), false)


def _excused(box: NDArray[np.float64], others: NDArray[np.float64]) -> bool:
    sides = np.minimum(box[2:], others[:, 2:]) - np.maximum(box[:2], others[:, :2])
    inside = np.prod(np.maximum(sides, 0.0), axis=1) / max(float(np.prod(box[2:] - box[:2])), 1e-9)
    return bool((inside > INSIDE_SHARE).any() or (iou(box, others) >= SAME_IOU).any())
