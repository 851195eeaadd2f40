"""Detections against true boxes: average precision by COCO's protocol, and the paper's counts at one score."""

import contextlib
import io
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from edgemap.geometry.errors import EdgemapError
from edgemap.geometry.objects.visibility import iou, shares_inside
from edgemap.geometry.observations.detections import Detections

IOU = 0.5  # least overlap of a match
PRIOR_BOXES = 20.0  # of all classes, beside a class's own: some classes have few


class EvaluationError(EdgemapError):
    """Data that cannot be scored, or a missing extra."""


@dataclass(frozen=True, slots=True, eq=False)
class ScoredPicture:
    """Truth and detections of one picture. Boxes (N, 4) xyxy px; labels index a common list; scores (N,).

    ignored: true boxes that are not scored, bool (N,); None where all are.
    """

    true_boxes: NDArray[np.float64]
    true_labels: NDArray[np.int64]
    boxes: NDArray[np.float64]
    labels: NDArray[np.int64]
    scores: NDArray[np.float64]
    ignored: NDArray[np.bool_] | None = None

    @property
    def scored(self) -> NDArray[np.bool_]:
        """True boxes that are scored, (N,)."""
        return np.ones(len(self.true_boxes), bool) if self.ignored is None else ~self.ignored

    @classmethod
    def compare(
        cls,
        true_boxes: NDArray[np.float64],
        true_labels: Sequence[str],
        ignored: NDArray[np.bool_],
        detections: Detections,
        numbers: Mapping[str, int],
    ) -> "ScoredPicture":
        """A picture by the classes in `numbers`, name to class id; others are left out."""
        scored_rows = [row for row, label in enumerate(true_labels) if label in numbers]
        labels = np.array([numbers[true_labels[row]] for row in scored_rows], dtype=np.int64)
        mine = np.isin(detections.class_ids, list(numbers.values()))
        boxes = true_boxes[scored_rows].reshape(-1, 4)
        return cls(
            boxes,
            labels,
            detections.boxes[mine],
            detections.class_ids[mine],
            detections.scores[mine],
            ignored[scored_rows],
        )


def average_precision(pictures: Sequence[ScoredPicture], names: Sequence[str]) -> dict[str, Any]:
    """AP (IoU 0.50:0.95) and AP50 over all classes with truth, and of each: `ap`, `ap50`, `per_class`.

    At most 100 detections of a picture count, as in COCO. An ignored box is neither hit nor miss: like a crowd of COCO,
    it absorbs every unmatched detection of its class whose share inside it exceeds the IoU threshold. Raises
    EvaluationError where there is no truth, or without the extra `evaluation`.
    """
    try:
        from faster_coco_eval import COCO, COCOeval_faster
    except ImportError:
        raise EvaluationError("detection figures need faster-coco-eval (extra evaluation)") from None
    truth, results = [], []
    for number, picture in enumerate(pictures, start=1):
        for box, label, crowd in zip(picture.true_boxes, picture.true_labels, ~picture.scored, strict=True):
            record = _record(number, box, label)
            about = {"id": len(truth) + 1, "iscrowd": int(crowd), "area": record["bbox"][2] * record["bbox"][3]}
            truth.append(record | about)
        for box, label, score in zip(picture.boxes, picture.labels, picture.scores, strict=True):
            results.append(_record(number, box, label) | {"score": float(score)})
    asked = [record for record in truth if not record["iscrowd"]]
    if not asked:
        raise EvaluationError(f"no true boxes in {len(pictures)} pictures: nothing to score")
    used = sorted({record["category_id"] for record in asked})
    counts = {"pictures": len(pictures), "boxes_true": len(asked), "boxes_ignored": len(truth) - len(asked)}
    if not results:
        none = {names[label - 1]: {"ap": 0.0, "ap50": 0.0} for label in used}
        return {"ap": 0.0, "ap50": 0.0, "per_class": none, **counts}
    document = {
        "info": {},
        "images": [{"id": number} for number, _ in enumerate(pictures, start=1)],
        "categories": [{"id": n, "name": name} for n, name in enumerate(names, start=1)],
        "annotations": truth,
    }
    with contextlib.redirect_stdout(io.StringIO()):
        reference = COCO(document)
        score = COCOeval_faster(reference, reference.loadRes(results), iouType="bbox")
        score.evaluate()
        score.accumulate()
    precision = score.eval["precision"][:, :, :, 0, -1]  # IoU x recall x class, all sizes, 100 detections
    categories = list(score.params.catIds)
    per_class = {}
    for label in used:
        column = precision[:, :, categories.index(label)]
        per_class[names[label - 1]] = {"ap": _mean(column), "ap50": _mean(column[0])}
    columns = [categories.index(label) for label in used]
    return {
        "ap": _mean(precision[:, :, columns]),
        "ap50": _mean(precision[0][:, columns]),
        "per_class": per_class,
        **counts,
    }


def _record(number: int, box: NDArray[np.float64], label: int) -> dict[str, Any]:
    x0, y0, x1, y1 = (float(v) for v in box)
    return {"image_id": number, "category_id": int(label) + 1, "bbox": [x0, y0, x1 - x0, y1 - y0]}


def _mean(precision: NDArray[np.float64]) -> float:
    valid = precision[precision > -1]
    return round(float(valid.mean()), 6) if valid.size else 0.0


@dataclass(frozen=True, slots=True, eq=False)
class Matches:
    """Matches of a picture's boxes at IoU 0.5. hit: (N,), detections that match; free: (N,), detections in an ignored
    box, which are not scored; found: (G,), true boxes that are matched.
    """

    hit: NDArray[np.bool_]
    free: NDArray[np.bool_]
    found: NDArray[np.bool_]


def match_boxes(picture: ScoredPicture) -> Matches:
    """Matches each detection, best score first, to the unmatched true box of its class with the greatest overlap."""
    hit, free = (np.zeros(len(picture.boxes), bool) for _ in range(2))
    found = np.zeros(len(picture.true_boxes), bool)
    for row in np.argsort(-picture.scores, kind="stable"):
        box, same = picture.boxes[row], picture.true_labels == picture.labels[row]
        overlap = iou(box, picture.true_boxes)
        open_ = same & picture.scored & ~found & (overlap >= IOU)
        if open_.any():
            found[np.flatnonzero(open_)[overlap[open_].argmax()]] = hit[row] = True
        else:
            free[row] = (same & ~picture.scored & (shares_inside(box, picture.true_boxes) >= IOU)).any()
    return Matches(hit, free, found)


@dataclass(frozen=True, slots=True)
class Counts:
    """true: boxes to detect. found: detected ones of these. false: false positives. Missed is true minus found."""

    true: int = 0
    found: int = 0
    false: int = 0

    @property
    def missed(self) -> int:
        """True boxes without a detection."""
        return self.true - self.found

    def __add__(self, other: "Counts") -> "Counts":
        return Counts(self.true + other.true, self.found + other.found, self.false + other.false)


def counts_by_class(pictures: Iterable[ScoredPicture]) -> dict[int, Counts]:
    """Counts at IoU 0.5 of each class that is labelled or detected. A detection in an ignored box is not scored."""
    totals: dict[int, Counts] = {}
    for picture in pictures:
        matches = match_boxes(picture)
        for label in np.unique([*picture.true_labels[picture.scored], *picture.labels[~matches.free]]).tolist():
            own, mine = picture.true_labels == label, picture.labels == label
            true, found = int((own & picture.scored).sum()), int((own & matches.found).sum())
            false = int((mine & ~matches.hit & ~matches.free).sum())
            totals[int(label)] = totals.get(int(label), Counts()) + Counts(true, found, false)
    return totals


def operating_point(pictures: Sequence[ScoredPicture], names: Sequence[str]) -> dict[str, Any]:
    """Precision and recall of these detections at IoU 0.5, over all classes and of each; None where undefined."""
    counts = counts_by_class(pictures)
    per_class = {names[label]: _point(counts[label]) for label in sorted(counts)}
    return {**_point(sum(counts.values(), Counts())), "per_class": per_class}


def break_even_scores(pictures: Sequence[ScoredPicture], names: Sequence[str]) -> dict[str, float]:
    """Score of each detected class from which on the boxes above it hold the most hits over false ones at IoU 0.5, and
    that of all classes under "". Boxes of all classes have a say as large as `PRIOR_BOXES` of each. Raises
    EvaluationError where nothing is detected.
    """
    matches = [match_boxes(picture) for picture in pictures]
    hit, free = (np.concatenate([getattr(one, key) for one in matches] or [[]]).astype(bool) for key in ("hit", "free"))
    scores = np.concatenate([picture.scores for picture in pictures] or [[]])[~free]
    labels, gain = (
        np.concatenate([picture.labels for picture in pictures] or [[]])[~free],
        np.where(hit[~free], 1.0, -1.0),
    )
    if not len(scores):
        raise EvaluationError(f"no boxes in {len(pictures)} pictures: nothing to calibrate")
    order = np.argsort(-scores, kind="stable")
    scores, labels, gain = scores[order], labels[order], gain[order]
    prior = np.cumsum(gain) * PRIOR_BOXES / len(gain)
    found: dict[str, NDArray[np.float64]] = {"": prior}
    for label in np.unique(labels):
        found[names[int(label)]] = prior + np.cumsum(gain * (labels == label))
    return {name: round(float(scores[sums.argmax()]), 3) for name, sums in found.items()}


def _point(counts: Counts) -> dict[str, float | None]:
    detected = counts.found + counts.false
    return {
        "precision": round(counts.found / detected, 6) if detected else None,
        "recall": round(counts.found / counts.true, 6) if counts.true else None,
    }
