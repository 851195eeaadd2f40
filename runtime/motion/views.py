"""Which pictures show another view: one view is one measurement, however long it lasts."""

from collections.abc import Iterable, Iterator

import cv2
from cv2.typing import MatLike

from edgemap.runtime.frames.frame import Frame
from edgemap.runtime.motion.health import HealthRule

COARSE_PX = (40, 30)  # of the pictures that are compared


class Views:
    """Compares pictures with the last one that showed another view. moved: mean grey levels by which one differs, as
    of `HealthRule`."""

    def __init__(self, moved: float) -> None:
        self._moved = moved
        self._last: MatLike | None = None

    def is_another(self, grey: MatLike) -> bool:
        """Whether a grey picture of any size shows another view than the last one that did; the first one does."""
        coarse = cv2.resize(grey, COARSE_PX, interpolation=cv2.INTER_AREA)
        if self._last is not None and float(cv2.absdiff(coarse, self._last).mean()) < self._moved:
            return False
        self._last = coarse
        return True


def views_of(frames: Iterable[Frame]) -> Iterator[Frame]:
    """The pictures that show another view than the previous one of the result; the first one is included."""
    views = Views(HealthRule().moved)
    return (frame for frame in frames if views.is_another(cv2.cvtColor(frame.image, cv2.COLOR_BGR2GRAY)))
