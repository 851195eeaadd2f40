"""A camera whose pictures a test makes."""

from collections.abc import Callable

import numpy as np

from edgemap.runtime.frames.camera import Camera, CameraInfo
from edgemap.runtime.frames.frame import Frame


class MadeCamera(Camera):
    """So many frames at a steady rate: picture_of(index). before: called with the index of each; may raise. fields: of
    `CameraInfo`."""

    def __init__(self, count: float, picture_of: Callable[[int], np.ndarray], rate_hz=10.0, start_s=0.0, before=None,
                 **fields) -> None:  # fmt: skip
        super().__init__(CameraInfo(**({"name": "made", "rate_hz": rate_hz} | fields)))
        self._count, self._picture_of, self._before = count, picture_of, before
        self._stamp_of = lambda index: start_s + index / rate_hz

    def read(self) -> Frame | None:
        index = self._delivered
        if self._before is not None:
            self._before(index)
        if index >= self._count:
            return None
        return self.frame(self._picture_of(index), self._stamp_of(index), "")


def raising(at: int | None, error: Exception) -> Callable[[int], None]:
    """A `before` that raises in place of one frame."""

    def before(index: int) -> None:
        if index == at:
            raise error

    return before
