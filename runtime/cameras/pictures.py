"""A list of pictures as a camera: every one, in order."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from edgemap.geometry.camera.intrinsics import Intrinsics
from edgemap.geometry.camera.mount import Mount
from edgemap.runtime.cameras.base import CameraBase
from edgemap.runtime.drives.layout import DEFAULT_RATE_HZ, read_setup
from edgemap.runtime.drives.pictures import list_pictures, read_picture
from edgemap.runtime.frame import Frame


class PicturesCamera(CameraBase):
    """Pictures on disk at stamps in seconds, one each. Raises CameraError where the first one is not a picture."""

    def __init__(
        self,
        name: str,
        pictures: Sequence[Path],
        stamps_s: NDArray[np.float64],
        intrinsics: Intrinsics | None = None,
        mount: Mount | None = None,
        rate_hz: float | None = DEFAULT_RATE_HZ,
    ) -> None:
        super().__init__(name, intrinsics, mount)
        self.rate_hz = rate_hz
        self.frame_count: int | None = len(pictures)
        height, width = read_picture(pictures[0]).shape[:2]
        self.size = (width, height)
        self._pictures, self._stamps_s = pictures, stamps_s

    def read(self) -> Frame | None:
        """The next picture; None after the last. Raises CameraError for a damaged or wrongly sized one."""
        if self._delivered >= len(self._pictures):
            return None
        path = self._pictures[self._delivered]
        return self.frame(read_picture(path), float(self._stamps_s[self._delivered]), str(path))

    def close(self) -> None:
        """Deliver nothing more."""
        self._pictures = ()


def open_folder(folder: Path, name: str, intrinsics: Intrinsics | None, mount: Mount | None) -> PicturesCamera:
    """A folder of pictures, natural order of names; its `camera.yaml` is honoured, the arguments go before it.

    Stamps are index / fps, 10 frames a second where no fps is known. Raises CameraError.
    """
    pictures = list_pictures(folder)
    setup = read_setup(folder, world_up="z")
    stamps = np.arange(len(pictures)) / setup.rate_hz
    return PicturesCamera(name, pictures, stamps, intrinsics or setup.intrinsics, mount or setup.mount, setup.rate_hz)
