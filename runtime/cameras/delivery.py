"""Judges what a live device delivers: stamp, size, format, repeats. What is in a picture is judged elsewhere."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from edgemap.runtime.cameras.device import Picture
from edgemap.runtime.cameras.fault import CameraFault, FaultKind
from edgemap.runtime.cameras.stamps import StreamClock

SAMPLE_STEP = 8  # px between the pixels that are compared
DARKEST, BRIGHTEST = 8.0, 247.0  # mean levels beyond which a colour picture may well have no colour


class DeliveryCheck:
    """Turns a device's pictures into those of one stream. size: (width, height) in px that every one must have.

    report: called with each fault. A fault that lasts several frames is reported once, when it begins.
    """

    def __init__(self, name: str, size: tuple[int, int], report: Callable[[CameraFault], None]) -> None:
        self.clock = StreamClock()
        self._name, self._size, self._report = name, size, report
        self._stamp_s: float | None = None
        self._sample: NDArray[np.uint8] | None = None
        self._coloured = False
        self._wrong: set[FaultKind] = set()

    def __call__(self, picture: tuple[float, NDArray[np.uint8]] | Picture, arrived_s: float) -> Picture | None:
        """The picture at its stamp in the stream; None where it is no new picture of this camera."""
        picture = picture if isinstance(picture, Picture) else Picture(picture[0], picture[1])
        stamp_s, image, depth = picture
        now: set[FaultKind] = set()
        bgr = self._shaped(image, now)
        if bgr is not None:
            same = self._same(bgr, now)
            if same and stamp_s == self._stamp_s:
                bgr = None
            else:
                stream_s, wrong = self.clock.stamp(float(stamp_s), arrived_s)
                if wrong is not None:
                    self._note(now, wrong, f"stamp {stamp_s:.6g} s after {self._stamp_s or 0.0:.6g} s, host's taken")
                picture, self._stamp_s = Picture(stream_s, bgr, depth), stamp_s
        self._wrong = now
        return None if bgr is None else picture

    def _shaped(self, image: NDArray[np.uint8], now: set[FaultKind]) -> NDArray[np.uint8] | None:
        image = np.asarray(image)
        if image.dtype == np.uint8 and (image.ndim == 2 or (image.ndim == 3 and image.shape[2] == 1)):
            self._note(now, FaultKind.GREY, "picture has one channel")
            image = np.repeat(image.reshape(*image.shape[:2], 1), 3, axis=2)
        if image.dtype != np.uint8 or image.ndim != 3 or image.shape[2] != 3:
            self._note(now, FaultKind.FORMAT, f"picture is {image.dtype} {image.shape}, not uint8 (H, W, 3)")
            return None
        height, width = image.shape[:2]
        if (width, height) != self._size:
            self._note(now, FaultKind.SIZE, f"picture is {width}x{height}, not {self._size[0]}x{self._size[1]} px")
            return None
        return image

    def _same(self, image: NDArray[np.uint8], now: set[FaultKind]) -> bool:
        sample = image[::SAMPLE_STEP, ::SAMPLE_STEP].copy()
        same = self._sample is not None and np.array_equal(sample, self._sample)
        self._sample = sample
        if same:
            self._note(now, FaultKind.STALE, "the same picture again")
        grey = bool((sample[..., :1] == sample).all())
        if grey and self._coloured and DARKEST < sample.mean() < BRIGHTEST:
            self._note(now, FaultKind.GREY, "pictures have lost their colour")
        self._coloured |= not grey
        return same

    def _note(self, now: set[FaultKind], kind: FaultKind, text: str) -> None:
        now.add(kind)
        if kind not in self._wrong:
            self._report(CameraFault(kind, f"camera {self._name}: {text}"))
