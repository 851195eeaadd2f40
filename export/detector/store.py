"""Training pictures in memory, decoded once at the network's input size, with their boxes; and pseudo-labels of
unlabelled ones: the averaged predictions of teachers, and the uncertain ones.
"""

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from edgemap.export.errors import ExportError
from edgemap.geometry.objects.visibility import iou
from edgemap.geometry.observations.detections import Detections
from edgemap.runtime.inputs.drives.drive import SEEN_SHARE, LabelledBoxes
from edgemap.runtime.inputs.drives.open import READERS, labelled_pictures, open_drive
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
    rows = [row for one in found for row in zip(one.scores, one.labels, one.boxes, strict=True)]
    groups: list[tuple[str, list[float], list[NDArray[np.float64]]]] = []
    for score, label, box in sorted(rows, key=lambda row: -row[0]):
        for name, scores, boxes in groups:
            if name == label and len(scores) < len(found) and iou(box, _mean(scores, boxes)[None])[0] > SAME_OVERLAP:
                scores.append(float(score))
                boxes.append(box)
                break
        else:
            groups.append((label, [float(score)], [box]))
    means = np.array([_mean(scores, boxes) for _, scores, boxes in groups]).reshape(-1, 4)
    total = np.array([sum(scores) / len(found) for _, scores, _ in groups])
    return means, [label for label, _, _ in groups], total


def evenly(count: int, limit: int | None) -> list[int]:
    """Indices of at most so many of `count`, evenly apart."""
    return np.unique(np.linspace(0, count - 1, min(limit or count, count)).astype(int)).tolist() if count else []


def _mean(scores: Sequence[float], boxes: Sequence[NDArray[np.float64]]) -> NDArray[np.float64]:
    return np.average(np.array(boxes), axis=0, weights=scores)


KEPT_SIZE = 1.15  # longer side of a kept picture, of the network's input: stretched to it, the shorter one is drawn out
UNTAUGHT = LabelledBoxes(np.zeros((0, 4)), (), np.zeros(0))
SMALLEST_PX = 10.0  # longer side at the network's input; what is smaller is no object to learn, nor background


@dataclass(frozen=True, slots=True, eq=False)
class Example:
    """A BGR picture with its boxes (N, 4) xyxy px, label numbers (N,), and the visible share of each (N,).

    unasked: boxes that evaluation ignores, (N,), as `LabelledBoxes.ignorable`; None after augmentation. source: index
    of the training's source. complete: (C,) bool, classes that the labels cover fully. kept: (C,) bool, classes for
    which training keeps the predictions of the reference network. scores: of a network that predicted the boxes, (N,);
    None where they are true.
    """

    image: NDArray[np.uint8]
    boxes: NDArray[np.float32]
    labels: NDArray[np.int64]
    visible: NDArray[np.float32]
    unasked: NDArray[np.bool_] | None = None
    source: int = 0
    complete: NDArray[np.bool_] = field(default_factory=lambda: np.zeros(0, dtype=np.bool_))
    kept: NDArray[np.bool_] = field(default_factory=lambda: np.zeros(0, dtype=np.bool_))
    scores: NDArray[np.float32] | None = None

    def certainty(self) -> NDArray[np.float32]:
        """Certainty of each box, (N,): 1 for labels."""
        return np.ones(len(self.boxes), dtype=np.float32) if self.scores is None else self.scores

    def ignored(self) -> NDArray[np.bool_]:
        """Boxes too small or too hidden to be asked for."""
        sides_px = (self.boxes[:, 2:] - self.boxes[:, :2]).max(axis=1, initial=0.0)
        return (self.visible < SEEN_SHARE) | (sides_px < SMALLEST_PX)


def load_examples(
    specs: Sequence[str], names: Sequence[str], size: int, limit: int | None = None, teach: Teacher | None = None
) -> list[Example]:
    """All pictures of `KIND:DIR...`, longer side `size` px; boxes of other classes than `names` are left out.

    Labels are complete for a class if any label of the source names it; the other classes are kept. Predicted boxes are
    complete for all classes, and all are kept. A plain folder holds unlabelled pictures: a teacher's predictions label
    them (`teach`); without one, no class is complete. limit: maximum number, taken evenly from each folder. Raises
    CameraError, or ExportError where labels hold no box at all.
    """
    number = {name: index for index, name in enumerate(names)}
    examples: list[Example] = []
    for source, spec in enumerate(specs):
        found = list(_load(spec, number, size, limit, teach))
        predicted = any(example.scores is not None for example in found)
        complete = np.full(len(names), predicted)
        complete[[label for example in found for label in example.labels]] = True
        kept = ~complete | predicted
        examples += [replace(example, source=source, complete=complete, kept=kept) for example in found]
    labelled = teach is not None or not all(map(is_unlabelled, specs))
    if labelled and not any(len(example.boxes) for example in examples):
        raise ExportError(f"{', '.join(specs)}: no true box of {', '.join(names)} in {len(examples)} pictures")
    return examples


def _load(spec: str, number: dict[str, int], size: int, limit: int | None, teach: Teacher | None) -> Iterator[Example]:
    if is_unlabelled(spec):
        paths = list_pictures(Path(spec))
        for image in (read_picture(paths[at]) for at in evenly(len(paths), limit)):
            yield _example(image, teach(image) if teach else UNTAUGHT, number, size)
        return
    drive = open_drive(spec)
    if not drive.images:
        for image, boxes in labelled_pictures(drive, limit):
            yield _example(image, boxes, number, size)
        return
    count = min(len(drive.images), len(drive.boxes))
    chosen = evenly(count, limit)
    with ThreadPoolExecutor(2) as pool:
        yield from pool.map(lambda at: _example(read_picture(drive.images[at]), drive.boxes[at], number, size), chosen)


def is_unlabelled(spec: str) -> bool:
    """Whether this names a plain folder of pictures and no `KIND:DIR`."""
    return spec.partition(":")[0] not in READERS and Path(spec).is_dir()


def _example(image: NDArray[np.uint8], truth: LabelledBoxes, number: dict[str, int], size: int) -> Example:
    height, width = image.shape[:2]
    scale = KEPT_SIZE * size / max(height, width)
    if scale < 1.0:
        small = max(1, int(width * scale + 1e-9)), max(1, int(height * scale + 1e-9))
        image = np.asarray(cv2.resize(image, small, interpolation=cv2.INTER_AREA), np.uint8)
    scale = min(1.0, scale)
    rows = [row for row, label in enumerate(truth.labels) if label in number]
    visible = np.ones(len(truth.labels)) if truth.visible is None else truth.visible
    return Example(
        image,
        (truth.boxes[rows].reshape(-1, 4) * scale).astype(np.float32),
        np.array([number[truth.labels[row]] for row in rows], dtype=np.int64),
        visible[rows].astype(np.float32),
        truth.ignorable()[rows],
        scores=None if truth.scores is None else truth.scores[rows].astype(np.float32),
    )
