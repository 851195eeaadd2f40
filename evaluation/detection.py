"""Detections against true boxes: average precision by COCO's protocol, and the paper's counts at one score."""

import contextlib
import io
from collections import Counter
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
    """Truth and detections of one picture. Boxes (N, 4) xyxy px; labels index a common list; scores (N,). scored:
    which true boxes are, (N,); the others are ignored."""

    true_boxes: NDArray[np.float64]
    true_labels: NDArray[np.int64]
    boxes: NDArray[np.float64]
    labels: NDArray[np.int64]
    scores: NDArray[np.float64]
    scored: NDArray[np.bool_]

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
        rows = [row for row, label in enumerate(true_labels) if label in numbers]
        labels = np.array([numbers[true_labels[row]] for row in rows], dtype=np.int64)
        mine = np.isin(detections.class_ids, list(numbers.values()))
        found = detections.boxes[mine], detections.class_ids[mine], detections.scores[mine]
        return cls(true_boxes[rows].reshape(-1, 4), labels, *found, ~ignored[rows])


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
    precision = np.zeros((1, 1, len(names)))  # IoU x recall x class
    if results:
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
        precision = score.eval["precision"][:, :, :, 0, -1]  # of all sizes, 100 detections

    def figures(classes: list[int]) -> dict[str, Any]:
        return {"ap": _mean(precision[:, :, classes]), "ap50": _mean(precision[0][:, classes])}

    used = sorted({record["category_id"] - 1 for record in asked})
    counts = {"pictures": len(pictures), "boxes_true": len(asked), "boxes_ignored": len(truth) - len(asked)}
    return {**figures(used), "per_class": {names[label]: figures([label]) for label in used}, **counts}


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


Counts = Counter[str]  # true: boxes to detect; found: detected ones of these; false: false positives


def counts_by_class(pictures: Iterable[ScoredPicture]) -> dict[int, Counts]:
    """Counts at IoU 0.5 of each class that is labelled or detected. A detection in an ignored box is not scored."""
    totals = {kind: Counter[int]() for kind in ("true", "found", "false")}
    for picture in pictures:
        matches = match_boxes(picture)
        totals["true"].update(picture.true_labels[picture.scored].tolist())
        totals["found"].update(picture.true_labels[matches.found].tolist())
        totals["false"].update(picture.labels[~matches.hit & ~matches.free].tolist())
    labels = sorted({label for counts in totals.values() for label in counts})
    return {label: Counter({kind: counts[label] for kind, counts in totals.items()}) for label in labels}


def operating_point(pictures: Sequence[ScoredPicture], names: Sequence[str]) -> dict[str, Any]:
    """Precision and recall of these detections at IoU 0.5, over all classes and of each; None where undefined."""
    counts = counts_by_class(pictures)
    per_class = {names[label]: _point(own) for label, own in counts.items()}
    return {**_point(sum(counts.values(), Counts())), "per_class": per_class}


def break_even_scores(pictures: Sequence[ScoredPicture], names: Sequence[str]) -> dict[str, float]:
    """Score of each detected class from which on the boxes above it hold the most hits over false ones at IoU 0.5, and
    that of all classes under "". Boxes of all classes have a say as large as `PRIOR_BOXES` of each. Raises
    EvaluationError where nothing is detected.
    """
    rows: list[NDArray[Any]] = [np.zeros((0, 3))]
    for picture in pictures:
        matches = match_boxes(picture)
        columns = picture.scores, picture.labels, np.where(matches.hit, 1.0, -1.0)
        rows.append(np.column_stack(columns)[~matches.free])
    table = np.vstack(rows)
    if not len(table):
        raise EvaluationError(f"no boxes in {len(pictures)} pictures: nothing to calibrate")
    scores, labels, gain = table[np.argsort(-table[:, 0], kind="stable")].T
    prior = np.cumsum(gain) * PRIOR_BOXES / len(gain)
    found: dict[str, NDArray[np.float64]] = {"": prior}
    for label in np.unique(labels):
        found[names[int(label)]] = prior + np.cumsum(gain * (labels == label))
    return {name: round(float(scores[sums.argmax()]), 3) for name, sums in found.items()}


def _point(counts: Counts) -> dict[str, float | None]:
    detected = counts["found"] + counts["false"]
    return {
        "precision": round(counts["found"] / detected, 6) if detected else None,
        "recall": round(counts["found"] / counts["true"], 6) if counts["true"] else None,
    }
