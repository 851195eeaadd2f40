"""A list of pictures, or a recorded drive, as a camera: every one, in order."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from edgemap.geometry.camera.intrinsics import Intrinsics
from edgemap.geometry.camera.mount import Mount
from edgemap.runtime.frames.errors import CameraError
from edgemap.runtime.frames.fault import CameraFault, FaultKind
from edgemap.runtime.frames.frame import Frame
from edgemap.runtime.inputs.cameras.base import CameraBase
from edgemap.runtime.inputs.cameras.video import VideoCamera
from edgemap.runtime.inputs.drives.camera_yaml import DEFAULT_RATE_HZ, read_setup
from edgemap.runtime.inputs.drives.drive import Drive
from edgemap.runtime.inputs.drives.pictures import list_pictures, read_picture, readable_depth


class PicturesCamera(CameraBase):
    """Pictures on disk at stamps in seconds, one each. Raises CameraError where none can be read."""

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
        self.size = _first_size(pictures)
        self._pictures, self._stamps_s = pictures, stamps_s
        self._next = 0

    def read(self) -> Frame | None:
        """The next picture; None after the last. Raises CameraFault for a damaged or wrongly sized one."""
        number, self._next = self._next, self._next + 1
        if number >= len(self._pictures):
            return None
        path = self._pictures[number]
        try:
            image = read_picture(path)
        except CameraError as error:
            raise CameraFault(FaultKind.DAMAGED, f"{error}, skipped") from None
        height, width = image.shape[:2]
        if (width, height) != self.size:
            raise CameraFault(
                FaultKind.SIZE,
                f"{path}: picture is {width}x{height}, the others are {self.size[0]}x{self.size[1]}, skipped",
            )
        depth = readable_depth(self.depth[number]) if self.depth else None
        return self.frame(image, float(self._stamps_s[number]), str(path), depth)

    def close(self) -> None:
        """Deliver nothing more."""
        self._pictures = ()


def _first_size(pictures: Sequence[Path]) -> tuple[int, int]:
    """(width, height) of the first picture that can be read. Raises the first one's CameraError where none can."""
    failure: CameraError | None = None
    for path in pictures:
        try:
            height, width = read_picture(path).shape[:2]
        except CameraError as error:
            failure = failure or error
            continue
        return width, height
    raise failure or CameraError("no pictures")


def open_folder(folder: Path, name: str, intrinsics: Intrinsics | None, mount: Mount | None) -> PicturesCamera:
    """A folder of pictures, natural order of names; its `camera.yaml` is used, but the arguments take precedence.
    Stamps are index / fps, with 10 frames per second by default. Raises CameraError.
    """
    pictures = list_pictures(folder)
    setup = read_setup(folder, world_up="z")
    stamps = np.arange(len(pictures)) / setup.rate_hz
    return PicturesCamera(name, pictures, stamps, intrinsics or setup.intrinsics, mount or setup.mount, setup.rate_hz)


def drive_camera(
    drive: Drive, name: str, intrinsics: Intrinsics | None = None, mount: Mount | None = None
) -> PicturesCamera | VideoCamera:
    """The drive's frames at the drive's stamps; given intrinsics or mount go before its own.

    A mount that was given does not move the truth: that was taken to the turn axis by the drive's own lever arm.
    """
    intrinsics, mount = intrinsics or drive.intrinsics, mount or drive.mount
    if drive.video is not None:
        camera = VideoCamera(name, drive.video, intrinsics, mount, [float(stamp) for stamp in drive.stamps_s])
    else:
        camera = PicturesCamera(name, drive.images, drive.stamps_s, intrinsics, mount)
    camera.rate_hz = drive.rate_hz
    camera.truth, camera.attitudes = drive.truth, drive.attitudes
    camera.wheel, camera.imu, camera.depth = drive.wheel, drive.imu, drive.depth
    return camera
