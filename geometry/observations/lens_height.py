"""The lens's height from objects of usual height on the floor: their boxes determine it at any range."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from edgemap.geometry.camera.floor import FloorCamera
from edgemap.geometry.observations.class_extents import HEIGHT_M, footprint_m
from edgemap.geometry.observations.detections import Detections
from edgemap.geometry.observations.occlusion import carried, covered

BORDER_PX = 3.0  # a box this near the picture's border may be cut
HIDDEN = 0.1  # share of a lower edge covered by nearer boxes, from which on the foot may be another one's
LEAST_SCORE = 0.5
LEAST_FALL, LEAST_RISE = 0.1, 0.05  # slopes of the rays to the foot, and from there to the top; less tells of pitch


@dataclass(frozen=True, slots=True)
class LensHeight:
    """height_m: of the lens, if this object is as high as usual for its label. fall: slope of the ray to its foot."""

    label: str
    height_m: float
    fall: float


def lens_heights(detections: Detections, camera: FloorCamera) -> list[LensHeight]:
    """Estimates of the lens's height, one for each complete box on the floor of a class with a usual height.

    f and t are the slopes, below the horizon, of the rays to foot and top. With the lens h above the floor the foot is
    h / f away, and so is the top of what rises above the lens: H = (f - t) h / f. For an object lower than the lens,
    the far edge of its top is visible, a usual depth behind.
    """
    labels, boxes = detections.labels, detections.boxes
    width, height = camera.intrinsics.width - BORDER_PX, camera.intrinsics.height - BORDER_PX
    inside = (boxes[:, :2] > BORDER_PX).all(axis=1) & (boxes[:, 2] < width) & (boxes[:, 3] < height)
    likely = inside & (detections.scores >= LEAST_SCORE)
    rows = [row for row in np.flatnonzero(likely).tolist() if labels[row] in HEIGHT_M]
    if not rows:
        return []
    held = carried(detections)
    rows = [row for row in rows if not held[row] and covered(boxes, row) < HIDDEN]
    falls, tops = _slopes(boxes[rows], camera)
    found = []
    for row, fall, top in zip(rows, falls.tolist(), tops.tolist(), strict=True):
        if fall < LEAST_FALL or fall - top < LEAST_RISE:
            continue
        usual_m, depth_m = HEIGHT_M[labels[row]][0], min(footprint_m(labels[row], 0.0))
        found.append(LensHeight(labels[row], fall * (usual_m + max(top, 0.0) * depth_m) / (fall - top), fall))
    return found


def _slopes(boxes: NDArray[np.float64], camera: FloorCamera) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Of the rays through the middles of the lower and upper edges of boxes (N, 4), positive downwards, (N,) each."""
    middle = (boxes[:, 0] + boxes[:, 2]) / 2.0 - 0.5
    rays = camera.rays_base(np.concatenate([np.column_stack([middle, boxes[:, side] - 0.5]) for side in (3, 1)]))
    slopes = -rays[:, 2] / np.maximum(np.linalg.norm(rays[:, :2], axis=1), 1e-9)
    return slopes[: len(boxes)], slopes[len(boxes) :]
