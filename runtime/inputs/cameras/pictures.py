"""Pictures, a video or a recorded drive as a camera: every frame, in order."""

import math
import shlex
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from edgemap.geometry.camera.depth_camera import DepthCamera
from edgemap.geometry.camera.intrinsics import Intrinsics
from edgemap.geometry.camera.mount import Mount
from edgemap.runtime.frames.camera import DEFAULT_RATE_HZ, Camera, CameraInfo
from edgemap.runtime.frames.errors import CameraError, CameraFault
from edgemap.runtime.frames.faults import FaultKind
from edgemap.runtime.frames.frame import Frame
from edgemap.runtime.frames.reading import library_path, one_line
from edgemap.runtime.inputs.cameras.checked import rate_of
from edgemap.runtime.inputs.drives.camera_yaml import read_setup
from edgemap.runtime.inputs.drives.drive import Drive, ridden
from edgemap.runtime.inputs.drives.pictures import (
    PIXEL_LIMIT,
    Depth,
    Levels,
    list_pictures,
    read_picture,
    readable_depth,
)


class FileCamera(Camera):
    """Pictures with depth pictures on disk, where there are any, one a picture. depth_camera: theirs, None where they
    are registered to the pictures."""

    depth: Sequence[Path] = ()
    depth_camera: DepthCamera | None = None

    def depth_of(self, number: int) -> Depth | str | None:
        """Depth of the picture of that number, of its pixels, or why it cannot be used; None where there is none."""
        depth = readable_depth(self.depth[number]) if self.depth else None
        if depth is None or isinstance(depth, str) or self.depth_camera is None:
            return depth
        if self.info.intrinsics is None:
            return None
        if (registered := self.depth_camera.registered(depth, self.info.intrinsics)) is None:
            return f"{depth.shape[1]}x{depth.shape[0]} px, its camera has another size"
        return registered


class VideoCamera(FileCamera):
    """A video that OpenCV decodes. stamps_s: where given, the video must have exactly one frame for each.

    Else stamps are the file's, or last + 1 / fps where those do not increase. Memory is bounded, independent of the
    size that the file claims. Raises CameraError for no video, and for one of too many pixels.
    """

    def __init__(
        self,
        name: str,
        path: Path,
        intrinsics: Intrinsics | None = None,
        mount: Mount | None = None,
        stamps_s: Sequence[float] | None = None,
    ) -> None:
        super().__init__(CameraInfo(name, intrinsics=intrinsics, mount=mount))
        if _is_text(path):  # a list of other files, which FFmpeg would play
            raise CameraError(f"{path}: a text, not a video")
        self._path, self._stamps_s, self._first_s = path, stamps_s, 0.0
        self._capture: cv2.VideoCapture | None = _open(path)
        if not self._capture.isOpened():
            self.close()
            raise CameraError(
                f"{path}: not a video that OpenCV reads ({path.stat().st_size} bytes): cut off, or another format"
            )
        wide, high = (int(self._capture.get(what)) for what in (cv2.CAP_PROP_FRAME_WIDTH, cv2.CAP_PROP_FRAME_HEIGHT))
        if wide * high > PIXEL_LIMIT:
            self.close()
            raise CameraError(f"{path}: video of {wide}x{high} px, at most {PIXEL_LIMIT:,} px are decoded")
        rate_hz = rate_of(self._capture.get(cv2.CAP_PROP_FPS))
        announced = int(self._capture.get(cv2.CAP_PROP_FRAME_COUNT))
        self._announced = announced if 0 < announced < 1 << 31 else None
        count = len(stamps_s) if stamps_s is not None else self._announced
        fourcc = int(self._capture.get(cv2.CAP_PROP_FOURCC)) & 0xFFFFFFFF
        codec = one_line(fourcc.to_bytes(4, "little").decode("ascii", "replace")) or "unknown"
        self._ahead = self._decode()  # what the header says of the size may be turned by the rotation tag
        if self._ahead is None:
            self.close()
            again = shlex.join(["ffmpeg", "-i", str(path), "-c:v", "libx264", f"{path.with_suffix('')}-h264.mp4"])
            raise CameraError(
                f"{path}: a video in which no frame can be decoded (codec {codec}, {announced} announced frames): "
                f"where it plays elsewhere, OpenCV lacks the codec: {again}"
            )
        height, width = self._ahead[0].shape[:2]
        self.update_info(size=(width, height), rate_hz=rate_hz, frame_count=count)

    def read(self) -> Frame | None:
        """The next frame; None at the end. Raises CameraError, after the last good frame, where the file is cut off."""
        if self._capture is None:
            return None
        decoded, self._ahead = self._ahead or self._decode(), None
        if decoded is None:
            self._check_end()
            return None
        if self._stamps_s is not None and self._delivered >= len(self._stamps_s):
            raise CameraError(f"{self._path}: more frames than the {len(self._stamps_s)} poses beside it")
        image, file_stamp_s = decoded
        depth, stamp_s = self.depth_of(self._delivered), self._stamp(file_stamp_s)
        self._first_s = self._first_s if self._delivered else stamp_s
        return self.frame(image, stamp_s, f"{self._path}#{self._delivered}", depth)

    def close(self) -> None:
        """Close the file."""
        if self._capture is not None:
            self._capture.release()
            self._capture = None

    def _decode(self) -> tuple[NDArray[np.uint8], float] | None:
        if self._capture is None:
            return None
        try:
            good, image = self._capture.read()
        except cv2.error:
            return None
        if not good or image is None:
            return None
        return np.asarray(image, dtype=np.uint8), self._capture.get(cv2.CAP_PROP_POS_MSEC) / 1000.0

    def _stamp(self, file_stamp_s: float) -> float:
        if self._stamps_s is not None:
            return float(self._stamps_s[self._delivered])
        if math.isfinite(file_stamp_s) and file_stamp_s > self._last_s:
            return file_stamp_s
        return self._last_s + 1.0 / (self.info.rate_hz or DEFAULT_RATE_HZ) if self._delivered else 0.0

    def _check_end(self) -> None:
        if self._stamps_s is not None and self._delivered < len(self._stamps_s):
            raise CameraError(
                f"{self._path}: ends after {self._delivered} frames, {len(self._stamps_s)} poses beside it"
            )
        if self._announced is None:
            return
        # A header's frame count is an estimate in some containers; a file that lacks more than this was cut off.
        allowed = max(3, 0.05 * self._announced)
        # Containers without a count announce their length times the rate: of a variable rate only the length holds.
        until = 1 + round((self._last_s - self._first_s) * (self.info.rate_hz or DEFAULT_RATE_HZ))
        if self._announced - max(self._delivered, until) > allowed:
            raise CameraError(f"{self._path}: cut off, {self._delivered} of {self._announced} announced frames decoded")


def _is_text(path: Path) -> bool:
    """Whether a file begins as texts do, without control characters; of videos only AVI and YUV4MPEG2 may."""
    with path.open("rb") as file:
        begin = file.read(8)
    text = not any(byte < 9 or 13 < byte < 32 for byte in begin)
    return begin != b"" and text and not begin.startswith((b"RIFF", b"YUV4MPEG"))


def _open(path: Path) -> cv2.VideoCapture:
    # Without a named backend OpenCV also takes the path for a picture pattern.
    known = cv2.videoio_registry.getBackends()
    return cv2.VideoCapture(library_path(path), cv2.CAP_FFMPEG if cv2.CAP_FFMPEG in known else cv2.CAP_ANY)


class PicturesCamera(FileCamera):
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
        self._levels = Levels()
        size, count = _first_size(pictures, self._levels), len(pictures)
        info = CameraInfo(name, size, intrinsics, mount, rate_hz=rate_hz, frame_count=count, notes=self._levels.notes)
        super().__init__(info)
        self._pictures, self._stamps_s = pictures, stamps_s
        self._next = 0

    def read(self) -> Frame | None:
        """The next picture; None after the last. Raises CameraFault for a damaged or wrongly sized one."""
        number, self._next = self._next, self._next + 1
        if number >= len(self._pictures):
            return None
        path = self._pictures[number]
        try:
            image = read_picture(path, self._levels)
        except CameraError as error:
            raise CameraFault(FaultKind.DAMAGED, f"{error}, skipped") from None
        height, width = image.shape[:2]
        wide, high = self.info.size
        if (width, height) != (wide, high):
            text = f"{path}: picture is {width}x{height}, the others are {wide}x{high}, skipped"
            raise CameraFault(FaultKind.SIZE, text)
        depth = self.depth_of(number)
        return self.frame(image, float(self._stamps_s[number]), str(path), depth)

    def close(self) -> None:
        """Deliver nothing more."""
        self._pictures = ()


def _first_size(pictures: Sequence[Path], levels: Levels) -> tuple[int, int]:
    """(width, height) of the first picture that can be read. Raises the first one's CameraError where none can."""
    failure: CameraError | None = None
    for path in pictures:
        try:
            height, width = read_picture(path, levels).shape[:2]
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
    """The drive's frames at the drive's stamps; stated intrinsics or mount override its.

    A stated mount does not move the truth: that was taken to the turn axis by the drive's lever arm.
    """
    intrinsics, mount = intrinsics or drive.intrinsics, ridden(drive.kind, mount or drive.mount)
    if drive.video is not None:
        camera = VideoCamera(name, drive.video, intrinsics, mount, [float(stamp) for stamp in drive.stamps_s])
    else:
        camera = PicturesCamera(name, drive.images, drive.stamps_s, intrinsics, mount)
    camera.update_info(
        rate_hz=drive.rate_hz, truth=drive.truth, attitudes=drive.attitudes, wheel=drive.wheel, imu=drive.imu
    )
    camera.depth, camera.depth_camera = drive.depth, drive.depth_camera
    return camera
