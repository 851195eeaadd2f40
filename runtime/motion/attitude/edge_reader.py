"""Detects a picture's straight edges over several frames: all at once take a third of a step."""

import math
from itertools import pairwise

import cv2
import numpy as np
from cv2.typing import MatLike

from edgemap.geometry.arrays import Array
from edgemap.geometry.camera.intrinsics import Intrinsics
from edgemap.runtime.frames.frame import Frame
from edgemap.runtime.motion.attitude.segments import Segments, line_ends, segments_between
from edgemap.runtime.motion.views import Views

# What a step can afford: pictures are scaled down to so many (192 x 144) and cut into strips, one of which is read a
# frame. Edges at twice the size are no more precise.
PIXELS, STRIPS = 27_648, 3


class EdgeReader:
    """Reads one picture at a time, and only one of each view; the first one at once, as a carried camera may be tilted
    by far. moved: as of `Views`. stamp_s: of the last picture that was offered."""

    def __init__(self, intrinsics: Intrinsics, moved: float) -> None:
        share = min(1.0, math.sqrt(PIXELS / (intrinsics.width * intrinsics.height)))
        self._lens = intrinsics.scaled(round(intrinsics.width * share), round(intrinsics.height * share))
        self._views, self._first = Views(moved), True
        self.stamp_s = -math.inf
        self.stop()

    @property
    def reading(self) -> bool:
        """Whether a picture is being read."""
        return bool(self._strips or self._ends)

    def begin(self, frame: Frame) -> bool:
        """Starts on a frame's picture, if it shows another view than the last one."""
        self.stamp_s = frame.stamp_s
        grey = cv2.cvtColor(frame.image, cv2.COLOR_BGR2GRAY)
        grey = cv2.resize(grey, (self._lens.width, self._lens.height), interpolation=cv2.INTER_AREA)
        if not self._views.is_another(grey):
            return False
        edges = np.linspace(0, self._lens.width, STRIPS + 1).astype(int).tolist()
        self._strips = [(left, grey[:, left:right]) for left, right in pairwise(edges)]
        return True

    def read(self) -> None:
        """Read the next strip; of the first picture all."""
        now = self._strips if self._first else self._strips[-1:]
        self._strips = self._strips[: len(self._strips) - len(now)]
        self._ends += [line_ends(strip, 1.0) + [left, 0.0] for left, strip in now]
        self._first &= not now

    def finished(self) -> Segments | None:
        """The edges of a picture, once, after all of it has been read; else None."""
        if self._strips or not self._ends:
            return None
        ends, self._ends = np.concatenate(self._ends), []
        return segments_between(ends, self._lens)

    def stop(self) -> None:
        """Discards the picture that is being read."""
        self._strips: list[tuple[int, MatLike]] = []  # not read yet, with their first columns
        self._ends: list[Array] = []  # of the edges in the others
