"""Boxes in pictures: YOLOv3, YOLOX and DFL decode rules, then class-wise non-maximum suppression."""

from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from edgemap.geometry.arrays import Array
from edgemap.geometry.objects.visibility import iou
from edgemap.geometry.observations.detections import Detections
from edgemap.runtime.frames.errors import BundleError
from edgemap.runtime.network.bundle import Bundle
from edgemap.runtime.network.layouts import Reading, rows_of, sigmoid
from edgemap.runtime.network.manifest import DetectorSpec, HeadSpec
from edgemap.runtime.network.network import Tensors
from edgemap.runtime.network.preprocess import Placement, Preprocessor

SAME_PLACE = 0.8  # IoU of boxes that are one object under two names
MAX_CANDIDATES = 1000  # before suppression; the best scores stay
# YOLOX (Ge et al. 2021) and generalized focal loss (Li et al. 2020), as PicoDet has it, in the terms of `layouts`.
READINGS = {
    "yolox": Reading(layout="objectness rows", form="cells"),
    "dfl": Reading(layout="bin rows", form="bins", activation="sigmoid"),
}


@dataclass(frozen=True, slots=True)
class Decoder:
    """Turns a backbone's heads into Detections, one label per box.

    confidence: minimum score (objectness times class probability) of a box. nms_iou: overlap above which the weaker of
    two boxes of one class is removed. These are two different thresholds. one_name: of overlapping boxes with different
    labels keep only the one with the most cell votes; average precision needs them all.
    """

    detector: DetectorSpec
    confidence: float = 0.3
    nms_iou: float = 0.45
    one_name: bool = False

    def __call__(self, outputs: Tensors, placement: Placement) -> Detections:
        """Boxes in picture px from the backbone's outputs, best first. Raises BundleError where a label has no name."""
        try:
            corners, scores, classes = self._candidates(outputs)
        except ValueError as error:
            raise BundleError(f"{self.detector.file}: {error}: state them with --names") from None
        names = tuple(entry.name for entry in self.detector.classes)
        if len(scores) == 0:
            return Detections.none(names)
        best = np.argsort(-scores, kind="stable")[:MAX_CANDIDATES]
        corners, scores, classes = corners[best], scores[best], classes[best]
        keep = suppress(corners, scores, classes, self.nms_iou)
        if self.one_name and len(set(classes[keep].tolist())) > 1:
            keep = keep[_elected(keep, corners, scores, classes)]
        return Detections(placement.to_image(corners[keep]), scores[keep], classes[keep], names)

    def _candidates(self, outputs: Tensors) -> tuple[Array, Array, NDArray[np.int64]]:
        """Boxes (N, 4) xyxy in px of the input with their scores and classes, before suppression."""
        detector, heads, strides = self.detector, self.detector.heads, ()
        size = (detector.input.width, detector.input.height)
        if detector.decode == "yolov3":
            parts = [_yolov3(outputs[head.name], head, self.confidence, size) for head in heads]
            corners, scores, classes = (np.concatenate(column) for column in zip(*parts, strict=True))
            return corners, scores, classes
        if (reading := detector.reading) is None:
            reading, strides = READINGS[detector.decode], tuple(one for head in heads for one in head.strides)
            maps = (outputs[head.name] for head in heads)  # (1, N, C), or (1, C, H, W) with a row of cells for each C
            rows = [one[0] if one.ndim == 3 else one.reshape(one.shape[1], -1).T for one in maps]
            outputs = {"rows": np.concatenate(rows)[None]}
        return rows_of(outputs, reading, len(detector.classes), self.confidence, size, strides)


def suppress(boxes: Array, scores: Array, classes: NDArray[np.int64], nms_iou: float) -> NDArray[np.int64]:
    """Class-wise non-maximum suppression: indices of the boxes (N, 4) xyxy that stay, best score first."""
    corner_size = np.concatenate([boxes[:, :2], boxes[:, 2:] - boxes[:, :2]], axis=1)
    kept = cv2.dnn.NMSBoxesBatched(corner_size.tolist(), scores.tolist(), classes.tolist(), 0.0, nms_iou)
    kept = np.asarray(kept, dtype=np.int64).reshape(-1)
    return kept[np.argsort(-scores[kept], kind="stable")]


def _elected(kept: NDArray[np.int64], boxes: Array, scores: Array, classes: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Which of the kept rows stay, where boxes of different labels overlap by more than SAME_PLACE: those whose label
    has the larger sum of scores among all boxes (N, 4) there."""
    votes = np.array([scores[(iou(boxes[row], boxes) > SAME_PLACE) & (classes == classes[row])].sum() for row in kept])
    stays = np.ones(len(kept), dtype=bool)
    for at in np.argsort(-votes, kind="stable"):
        if stays[at]:
            rivals = (iou(boxes[kept[at]], boxes[kept]) > SAME_PLACE) & (classes[kept] != classes[kept[at]])
            stays &= ~rivals
    return stays


def _yolov3(output: NDArray[np.float32], head: HeadSpec, confidence: float, size: tuple[int, int]) -> tuple:
    """YOLOv3 (Redmon and Farhadi 2018, section 2.1): logits (1, A*(5+C), H, W) to boxes xyxy in input px.

    Only cells whose objectness passes the threshold are looked at: score = objectness * class <= objectness.
    """
    _, channels, rows, columns = output.shape
    anchors = np.array(head.anchors, dtype=np.float64)
    grid = output.reshape(len(anchors), channels // len(anchors), rows * columns)
    anchor, cell = np.nonzero(sigmoid(grid[:, 4]) >= confidence)
    logits = grid[anchor, :, cell].astype(np.float64)
    classes = logits[:, 5:].argmax(axis=1)
    scores = sigmoid(logits[:, 4]) * sigmoid(logits[np.arange(len(logits)), 5 + classes])
    strong = scores >= confidence
    logits, anchor, cell = logits[strong], anchor[strong], cell[strong]
    offset = (head.scale_xy - 1.0) / 2.0
    xy = sigmoid(logits[:, :2]) * head.scale_xy - offset + np.column_stack([cell % columns, cell // columns])
    centres, half = xy * [size[0] / columns, size[1] / rows], np.exp(logits[:, 2:4]) * anchors[anchor] / 2.0
    return np.concatenate([centres - half, centres + half], axis=1), scores[strong], classes[strong]


Stage = Callable[[str], AbstractContextManager[object]]  # times a block under a name


class Detector:
    """A bundle's detector without odometry or map, for pictures of any size, or of the one that it was fitted to."""

    def __init__(self, bundle: Bundle, decode: Decoder | None = None) -> None:
        self._backbone = bundle.backbone
        self._input_name = bundle.manifest.detector.input.name
        self._preprocess = Preprocessor(bundle.detector.input)
        self._decode = decode or Decoder(bundle.detector)

    def __call__(self, image: NDArray[np.uint8]) -> Detections:
        """Detections in a BGR uint8 picture (H, W, 3), best first."""
        return self._decode(*self.raw(image))

    def raw(self, image: NDArray[np.uint8], stage: Stage = nullcontext) -> tuple[Tensors, Placement]:
        """The backbone's outputs, for any decoder. stage: times each of the two."""
        with stage("preprocess"):
            tensor, placement = self._preprocess(image)
        with stage("backbone"):
            return self._backbone.run({self._input_name: tensor}), placement


class DetectorBeside:
    """A detector in a separate thread, one picture at a time: a call hands it the next one and returns the boxes of the
    one before, for which it waits; None at first. Which boxes a call returns does not depend on wall time."""

    def __init__(self, detector: Detector) -> None:
        self._detector, self._worker = detector, ThreadPoolExecutor(1, "detector")
        self._boxes: Future[Detections] | None = None

    @property
    def busy(self) -> bool:
        """Whether a call would have to wait."""
        return self._boxes is not None and not self._boxes.done()

    def __call__(self, image: NDArray[np.uint8]) -> Detections | None:
        """Boxes of the picture before. image: BGR uint8 (H, W, 3), which nothing may change from now on."""
        boxes = self.last()
        self._boxes = self._worker.submit(self._detector, image)
        return boxes

    def last(self) -> Detections | None:
        """Boxes of the picture that it was handed last, once; None without one."""
        boxes, self._boxes = self._boxes, None
        return boxes and boxes.result()
