"""Pseudo-labels of unlabelled pictures: the averaged predictions of teachers, and the uncertain ones."""

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from edgemap.geometry.observations.detections import Detections
from edgemap.runtime.inputs.drives.drive import LabelledBoxes
from edgemap.runtime.inputs.drives.pictures import list_pictures, read_picture
from edgemap.runtime.inputs.drives.yolo import DOUBT_SCORE, predicted_boxes
from edgemap.runtime.network.bundle import Bundle
from edgemap.runtime.network.decode import Decoder, Detector

SAME_OVERLAP = 0.55  # IoU of boxes of one class that are one object to two teachers

Teacher = Callable[[NDArray[np.uint8]], LabelledBoxes]


def teacher_of(bundles: Sequence[Bundle]) -> Teacher:
    """A function from a BGR picture to these bundles' averaged boxes; `visible` is 0 for uncertain ones."""
    detectors = [
        Detector(bundle, Decoder(bundle.manifest.detector, DOUBT_SCORE / len(bundles), 0.6)) for bundle in bundles
    ]

    def teach(image: NDArray[np.uint8]) -> LabelledBoxes:
        return predicted_boxes(*averaged([detect(image) for detect in detectors]))

    return teach


def averaged(found: Sequence[Detections]) -> tuple[NDArray[np.float64], list[str], NDArray[np.float64]]:
    """Weighted boxes fusion (Solovyev et al. 2021): (N, 4) boxes, names, scores; a teacher that misses counts as 0."""
    rows = sorted(
        (
            (score, label, box)
            for one in found
            for score, label, box in zip(one.scores, one.labels, one.boxes, strict=True)
        ),
        key=lambda row: -row[0],
    )
    groups: list[tuple[str, list[float], list[NDArray[np.float64]]]] = []
    for score, label, box in rows:
        for name, scores, boxes in groups:
            if name == label and len(scores) < len(found) and _overlap(box, _mean(scores, boxes)) > SAME_OVERLAP:
                scores.append(float(score))
                boxes.append(box)
                break
        else:
            groups.append((label, [float(score)], [box]))
    means = np.array([_mean(scores, boxes) for _, scores, boxes in groups]).reshape(-1, 4)
    total = np.array([sum(scores) / len(found) for _, scores, _ in groups])
    return means, [label for label, _, _ in groups], total


def taught_pictures(folder: Path, teach: Teacher, limit: int | None = None) -> list[tuple[Path, LabelledBoxes]]:
    """The pictures of a folder, evenly chosen up to `limit`, each with its teachers' boxes. Raises CameraError."""
    paths = list_pictures(folder)
    chosen = np.unique(np.linspace(0, len(paths) - 1, min(limit or len(paths), len(paths))).astype(int))
    return [(paths[at], teach(read_picture(paths[at]))) for at in chosen]


def _mean(scores: Sequence[float], boxes: Sequence[NDArray[np.float64]]) -> NDArray[np.float64]:
    return np.average(np.array(boxes), axis=0, weights=scores)


def _overlap(a: NDArray[np.float64], b: NDArray[np.float64]) -> float:
    common = np.clip(np.minimum(a[2:], b[2:]) - np.maximum(a[:2], b[:2]), 0.0, None).prod()
    return float(common / ((a[2:] - a[:2]).prod() + (b[2:] - b[:2]).prod() - common))
