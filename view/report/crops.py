"""Each object's best picture, chosen during the run: at most one small JPEG per object is kept."""

import math
from collections.abc import Collection
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from edgemap.runtime.frames.frame import jpeg
from edgemap.runtime.step.slam import StepResult

SIDE_PX = 200  # longer side of a kept picture
MAXIMUM_CROPS = 400  # pictures kept at a time, 3 MB or so
BETTER = 1.3  # a new picture must be this much better, so that a slow approach does not replace it every frame
BORDER_PX = 3.0
_MARGIN = 0.10  # of the box, shown around it
_SHARP = 60.0  # variance of the Laplacian at which a picture counts as half sharp
_CUT = 0.2  # a box cut by the border is worth this much of a complete one


@dataclass(frozen=True, slots=True)
class Crop:
    """quality: score x size x sharpness, 0..1. jpeg: the file. frame: which one it was cut from."""

    quality: float
    jpeg: bytes
    frame: int


class BestCrops:
    """The best crop of every object so far: sharp, confident, large, not cut by the border."""

    def __init__(self) -> None:
        self._best: dict[str, Crop] = {}

    def __len__(self) -> int:
        return len(self._best)

    def consider(self, result: StepResult) -> None:
        """Considers one step's sightings; a picture is cropped only where it could be better than the stored one."""
        image = result.pictured.image
        for placed, identity in zip(result.sightings, result.object_ids, strict=True):
            box = result.detections.boxes[placed.sighting.detection]
            kept = self._best.get(identity)
            limit = kept.quality * BETTER if kept else 0.0
            worth = _worth(box, placed.sighting.score, image.shape)
            if worth <= limit:
                continue
            picture = _cut(image, box)
            if picture is None:
                continue
            quality = worth * _sharpness(picture)
            if quality > limit:
                self._best[identity] = Crop(quality, jpeg(small(picture, SIDE_PX), 78), result.pictured.index)

    def keep(self, identities: Collection[str], merged: dict[str, str]) -> None:
        """Hand pictures of merged objects to those that they became part of; past `MAXIMUM_CROPS`, drop those of
        objects that are not (or no longer) on the map, worst first, then the worst of all."""
        for identity in [name for name in self._best if name in merged]:
            crop, heir = self._best.pop(identity), merged[identity]
            if heir not in self._best or self._best[heir].quality < crop.quality:
                self._best[heir] = crop
        if len(self._best) > MAXIMUM_CROPS:
            order = sorted(self._best, key=lambda name: (name in identities, self._best[name].quality))
            for identity in order[: len(self._best) - MAXIMUM_CROPS]:
                del self._best[identity]

    def of(self, identities: Collection[str]) -> dict[str, Crop]:
        """The pictures of these objects, those that have one."""
        return {identity: self._best[identity] for identity in identities if identity in self._best}


def _worth(box: NDArray[np.float64], score: float, shape: tuple[int, ...]) -> float:
    """Quality of a box were its picture perfectly sharp, 0..1."""
    height, width = shape[:2]
    x0, y0, x1, y1 = box
    side_px = math.sqrt(max(x1 - x0, 0.0) * max(y1 - y0, 0.0))
    whole = x0 > BORDER_PX and y0 > BORDER_PX and x1 < width - BORDER_PX and y1 < height - BORDER_PX
    return score * min(1.0, side_px / SIDE_PX) * (1.0 if whole else _CUT)


def _cut(image: NDArray[np.uint8], box: NDArray[np.float64]) -> NDArray[np.uint8] | None:
    """The box with a margin, a view; None for a box without pixels."""
    height, width = image.shape[:2]
    x0, y0, x1, y1 = box
    pad_x, pad_y = _MARGIN * (x1 - x0), _MARGIN * (y1 - y0)
    left, right = int(max(x0 - pad_x, 0)), int(min(x1 + pad_x, width))
    top, bottom = int(max(y0 - pad_y, 0)), int(min(y1 + pad_y, height))
    if right - left < 4 or bottom - top < 4:
        return None
    return image[top:bottom, left:right]


def small(picture: NDArray[np.uint8], side_px: int) -> NDArray[np.uint8]:
    """At most so long. Linear, because averaging over areas costs ten times as much."""
    share = side_px / max(picture.shape[:2])
    if share >= 1.0:
        return picture
    size = (max(1, round(picture.shape[1] * share)), max(1, round(picture.shape[0] * share)))
    return np.asarray(cv2.resize(picture, size, interpolation=cv2.INTER_LINEAR), dtype=np.uint8)


def _sharpness(picture: NDArray[np.uint8]) -> float:
    """0..1: variance of the Laplacian (Pech-Pacheco et al. 2000) of its green against `_SHARP`; of every nth pixel
    of a large one, so that the cost stays small."""
    every = 1 + max(picture.shape[:2]) // SIDE_PX
    edges = cv2.Laplacian(np.ascontiguousarray(picture[::every, ::every, 1]), cv2.CV_16S)
    variance = float(cv2.meanStdDev(edges)[1][0, 0]) ** 2
    return (variance + 1.0) / (variance + 1.0 + _SHARP)
