"""Estimates the height of the lens from boxes of objects on the floor whose height is usual for their class.

A box determines the height at any range of the object.
"""

import math
from collections import defaultdict, deque
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from edgemap.geometry.arrays import Array
from edgemap.geometry.camera.floor import FloorCamera
from edgemap.geometry.observations.class_extents import HEIGHT_M, footprint_m
from edgemap.geometry.observations.detections import Detections
from edgemap.geometry.observations.occlusion import EDGE_PX, carried, covered
from edgemap.geometry.robust import median_and_scatter

HIDDEN = 0.1  # share of a lower edge that nearer boxes cover; from it on, the foot may belong to another object
LEAST_SCORE = 0.5
LEAST_SLOPE = 0.05  # to the foot, and from foot to top; less shows pitch
WORST_SHARE = 0.3  # beds and refrigerators scatter more, and many a door is called a refrigerator
UNUSUAL = math.inf, math.inf  # of a class without a usual height
BOX_SHARE = 0.1  # standard deviation of one box's height, as a share


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
    a home, so each class is one measurement: the median over its boxes."""

    def __init__(self, kept: int) -> None:
        self._rays: dict[str, deque[Array]] = defaultdict(lambda: deque(maxlen=kept))

    @property
    def count(self) -> int:
        """Boxes that are kept."""
        return sum(map(len, self._rays.values()))

    def add(self, boxes: Detections, camera: FloorCamera) -> None:
        """Adds the boxes of one picture. Pictures must be so far apart that each is another view."""
        for label, rays in zip(*complete_boxes(boxes, camera), strict=True):
            self._rays[label].append(rays)

    def turn(self, rotation: Array) -> None:
        """Takes the boxes by another mount. rotation: (3, 3), from the base frame by the old mount to the new one's."""
        for kept in self._rays.values():
            rays = np.array(kept).reshape(-1, 2, 3) @ rotation.T
            kept.clear()
            kept.extend(rays[_are_steep(rays)])

    def measurements(self, pitch_rad: float, fewest: int = 1) -> list[HeightMeasurement]:
        """One for each class of so many boxes or more. pitch_rad: standard deviation of the pitch, which they share."""
        measured = list[HeightMeasurement]()
        for label, rays in self._rays.items():
            if len(rays) >= fewest:
                heights_m, falls = lens_heights([label] * len(rays), np.array(rays))
                (middle, fall), (scatter, _) = median_and_scatter(np.column_stack([np.log(heights_m), falls]))
                random = math.hypot(scatter, BOX_SHARE) / math.sqrt(len(rays))
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


def complete_boxes(detections: Detections, camera: FloorCamera) -> tuple[list[str], Array]:
    """Labels of the complete boxes on the floor whose class has a usual height, and the rays to the middles of their
    feet and tops, base frame, (N, 2, 3)."""
    labels, boxes = detections.labels, detections.boxes
    width, height = camera.intrinsics.width - EDGE_PX, camera.intrinsics.height - EDGE_PX
    inside = (boxes[:, :2] > EDGE_PX).all(axis=1) & (boxes[:, 2] < width) & (boxes[:, 3] < height)
    likely = inside & (detections.scores >= LEAST_SCORE)
    rows = [row for row in np.flatnonzero(likely).tolist() if HEIGHT_M.get(labels[row], UNUSUAL)[1] <= WORST_SHARE]
    if not rows:
        return [], np.zeros((0, 2, 3))
    held = carried(detections)
    rows = [row for row in rows if not held[row] and covered(boxes, row) < HIDDEN]
    middle = (boxes[rows, 0] + boxes[rows, 2]) / 2.0 - 0.5
    rays = camera.rays_base(np.concatenate([np.column_stack([middle, boxes[rows, side] - 0.5]) for side in (3, 1)]))
    rays = np.stack([rays[: len(rows)], rays[len(rows) :]], axis=1)
    steep = np.flatnonzero(_are_steep(rays))
    return [labels[rows[at]] for at in steep], rays[steep]


def lens_heights(labels: Sequence[str], rays: Array) -> tuple[Array, Array]:
    """The height of the lens (N,) if each object has the usual height of its label, and the slope (N,) of the ray to
    its foot, positive downwards. rays: as of `complete_boxes`.

    f and t are the slopes, below the horizon, of the rays to the foot and to the top. h is the height of the lens. The
    range of the foot is h / f. An object that is higher than the lens has its top at the same range, so its height is
    H = (f - t) h / f. If the object is lower than the lens, the visible top edge is the far one, behind by the usual
    depth of the class.
    """
    usual_m, depths_m = (
        np.array([(HEIGHT_M[label][0], min(footprint_m(label, 0.0))) for label in labels]).reshape(-1, 2).T
    )
    falls, tops = _slopes(rays).T
    return falls * (usual_m + np.maximum(tops, 0.0) * depths_m) / (falls - tops), falls


def _slopes(rays: Array) -> Array:
    """Slopes (N, 2) of rays (N, 2, 3), positive downwards."""
    return -rays[..., 2] / np.maximum(np.linalg.norm(rays[..., :2], axis=-1), 1e-9)


def _are_steep(rays: Array) -> NDArray[np.bool_]:
    """Whether the slopes (N,) of rays (N, 2, 3) to feet and tops are large enough."""
    falls, tops = _slopes(rays).T
    return (falls >= LEAST_SLOPE) & (falls - tops >= LEAST_SLOPE)
