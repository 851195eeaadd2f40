"""Straight edges of a picture, as planes through the lens."""

from dataclasses import dataclass

import cv2
import numpy as np
from cv2.typing import MatLike
from numpy.typing import NDArray

from edgemap.geometry.arrays import Array
from edgemap.geometry.camera.intrinsics import Intrinsics

SHORTEST_SHARE = 0.06  # of the picture's width
MAXIMUM_SEGMENTS = 100  # the longest ones of a picture
LSD_SCALE = 0.8  # of a full picture, at which LSD looks at it, against the stairs of its pixels


@dataclass(frozen=True, slots=True, eq=False)
class Segments:
    """Edges of one picture.

    normals: (N, 3), unit normals of the planes through lens and edge, optical frame: an edge along direction d in space
    has normal . d = 0. lengths: (N,) rad, visual angle.
    """

    normals: Array
    lengths: Array

    def __len__(self) -> int:
        return len(self.lengths)


def find_segments(image: NDArray[np.uint8], lens: Intrinsics) -> Segments:
    """Line segments of a BGR picture (LSD: Grompone von Gioi et al. 2012), short ones left out."""
    return segments_between(line_ends(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)), lens)


def line_ends(grey: MatLike, scale: float = LSD_SCALE) -> Array:
    """Both ends of each line that LSD finds in a grey picture, (N, 2, 2) px; 1.0 for one that was averaged down."""
    lines = cv2.createLineSegmentDetector(scale=scale).detect(np.ascontiguousarray(grey))[0]
    if lines is None:
        return np.zeros((0, 2, 2))
    # LSD gives x / scale back, where it should give (x + 0.5) / scale - 0.5.
    return np.asarray(lines, dtype=np.float64).reshape(-1, 2, 2) + (0.5 / scale - 0.5)


def segments_between(ends: Array, lens: Intrinsics) -> Segments:
    """Lines of a picture by their ends (N, 2, 2) px, short ones left out."""
    ends = longest(ends, lens.width)
    first, last = (_unit(lens.rays(ends[:, i])) for i in (0, 1))
    planes = np.cross(first, last)
    return Segments(_unit(planes), np.arcsin(np.clip(np.linalg.norm(planes, axis=1), 0.0, 1.0)))


def longest(ends: Array, width: int) -> Array:
    """The lines (N, 2, 2) px that `segments_between` uses of a picture of this width."""
    px = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    keep = np.argsort(-px)[:MAXIMUM_SEGMENTS]
    return ends[keep[px[keep] > SHORTEST_SHARE * width]]


def _unit(vectors: Array) -> Array:
    return vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-12)
