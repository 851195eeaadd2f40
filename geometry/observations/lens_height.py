"""Estimates the height of the lens from boxes of objects on the floor whose height is usual for their class.

A box determines the height at any range of the object.
"""

import math
from collections import defaultdict, deque
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from edgemap.geometry.camera.floor import FloorCamera
from edgemap.geometry.observations.class_extents import HEIGHT_M, footprint_m
from edgemap.geometry.observations.detections import Detections
from edgemap.geometry.observations.occlusion import EDGE_PX, carried, covered
from edgemap.geometry.robust import median_and_scatter

HIDDEN = 0.1  # share of a lower edge that nearer boxes cover; from it on, the foot may belong to another object
LEAST_SCORE = 0.5
LEAST_SLOPE = 0.05  # to the foot, and from foot to top; less shows pitch
WORST_SHARE = 0.3  # beds and refrigerators scatter more, and many a door is called a refrigerator
BOX_SHARE = 0.1  # standard deviation of one box's height, as a share


@dataclass(frozen=True, slots=True)
class LensHeight:
    """Estimate from one object. height_m: height of the lens if the object has the usual height of its label. fall:
    slope of the ray to the foot of the object, positive downwards. rays: to foot and top, base frame, (2, 3).
    """

    label: str
    height_m: float
    fall: float
    rays: NDArray[np.float64] = field(repr=False, compare=False)


@dataclass(frozen=True, slots=True)
class HeightMeasurement:
    """The lens's height by one source. log_m: logarithm of it in metres. sigma: standard deviation of that. shared: the
    part of it that the pitch error causes, which has one sign in all measurements.
    """

    name: str
    log_m: float
    sigma: float
    shared: float = 0.0


class HeightBySizes:
    """Collects what boxes show of the lens's height, the last `kept` of each class. Objects of a class are alike within
    a home, so each class is one measurement: the median over its boxes. count: of all boxes."""

    def __init__(self, kept: int) -> None:
        self._kept = kept
        self._heights: dict[str, deque[LensHeight]] = defaultdict(lambda: deque(maxlen=kept))

    @property
    def count(self) -> int:
        """Boxes that are kept."""
        return sum(map(len, self._heights.values()))

    def add(self, boxes: Detections, camera: FloorCamera) -> None:
        """Adds the boxes of one picture. Pictures must be so far apart that each is another view."""
        for estimate in lens_heights(boxes, camera):
            self._heights[estimate.label].append(estimate)

    def turned(self, rotation: NDArray[np.float64]) -> "HeightBySizes":
        """The same boxes by another mount. rotation: (3, 3), from the base frame by the old mount to the new one's."""
        turned = HeightBySizes(self._kept)
        for label, heights in self._heights.items():
            rays = np.array([one.rays for one in heights]).reshape(-1, 2, 3) @ rotation.T
            turned._heights[label].extend(_by_rays([label] * len(rays), rays))
        return turned

    def measurements(self, pitch_rad: float, fewest: int = 1) -> list[HeightMeasurement]:
        """One for each class of so many boxes or more. pitch_rad: standard deviation of the pitch, which they share."""
        measured = list[HeightMeasurement]()
        for label, heights in self._heights.items():
            if len(heights) >= fewest:
                (middle, fall), (scatter, _) = median_and_scatter(
                    np.array([(math.log(one.height_m), one.fall) for one in heights])
                )
                random = math.hypot(scatter, BOX_SHARE) / math.sqrt(len(heights))
                shared = pitch_rad / float(fall)
                sigma = math.hypot(HEIGHT_M[label][1], shared, random)
                measured.append(HeightMeasurement(label, float(middle), sigma, shared))
        return measured


def agreed_height(measurements: Sequence[HeightMeasurement]) -> tuple[float, float]:
    """Weighted mean of the logarithms, and its standard deviation; more where they disagree (Birge 1932). The error
    that all measurements share is not averaged out: it is added unchanged.
    """
    logs, weights = np.array([one.log_m for one in measurements]), np.array([one.sigma**-2 for one in measurements])
    mean = float(np.average(logs, weights=weights))
    scatter2 = float((logs - mean) ** 2 @ weights) / max(len(logs) - 1, 1)
    shared = np.array([one.shared for one in measurements])
    own2 = 1.0 / weights - shared**2
    variance = (float(own2 @ weights**2) + float(shared @ weights) ** 2) / float(weights.sum()) ** 2
    return mean, math.sqrt(max(scatter2, 1.0) * variance)


def lens_heights(detections: Detections, camera: FloorCamera) -> list[LensHeight]:
    """Estimates the height of the lens from each complete box on the floor whose class has a usual height.

    f and t are the slopes, below the horizon, of the rays to the foot and to the top. h is the height of the lens. The
    range of the foot is h / f. An object that is higher than the lens has its top at the same range, so its height is
    H = (f - t) h / f. If the object is lower than the lens, the visible top edge is the far one, behind by the usual
    depth of the class.
    """
    labels, boxes = detections.labels, detections.boxes
    width, height = camera.intrinsics.width - EDGE_PX, camera.intrinsics.height - EDGE_PX
    inside = (boxes[:, :2] > EDGE_PX).all(axis=1) & (boxes[:, 2] < width) & (boxes[:, 3] < height)
    likely = inside & (detections.scores >= LEAST_SCORE)
    usual = [row for row in np.flatnonzero(likely).tolist() if labels[row] in HEIGHT_M]
    rows = [row for row in usual if HEIGHT_M[labels[row]][1] <= WORST_SHARE]
    if not rows:
        return []
    held = carried(detections)
    rows = [row for row in rows if not held[row] and covered(boxes, row) < HIDDEN]
    return _by_rays([labels[row] for row in rows], _rays(boxes[rows], camera))


def _by_rays(labels: Sequence[str], rays: NDArray[np.float64]) -> list[LensHeight]:
    """Estimates from the rays to foot and top of objects, base frame, (N, 2, 3); none by slopes that are too small."""
    slopes = -rays[..., 2] / np.maximum(np.linalg.norm(rays[..., :2], axis=-1), 1e-9)
    estimates = []
    for label, (fall, top), both in zip(labels, slopes.tolist(), rays, strict=True):
        if fall < LEAST_SLOPE or fall - top < LEAST_SLOPE:
            continue
        usual_m, depth_m = HEIGHT_M[label][0], min(footprint_m(label, 0.0))
        estimates.append(LensHeight(label, fall * (usual_m + max(top, 0.0) * depth_m) / (fall - top), fall, both))
    return estimates


def _rays(boxes: NDArray[np.float64], camera: FloorCamera) -> NDArray[np.float64]:
    """The rays through the middles of the lower and upper edges of boxes (N, 4), base frame: (N, 2, 3)."""
    middle = (boxes[:, 0] + boxes[:, 2]) / 2.0 - 0.5
    rays = camera.rays_base(np.concatenate([np.column_stack([middle, boxes[:, side] - 0.5]) for side in (3, 1)]))
    return np.stack([rays[: len(boxes)], rays[len(boxes) :]], axis=1)
