"""Pictures, colour and depth: those that a folder holds, files with their size and damage noticed, raw pixels, and
depth in order of time."""

import os
import re
from collections.abc import Callable, Generator
from contextlib import suppress
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from cv2.typing import MatLike
from numpy.typing import NDArray

from edgemap.runtime.frames.camera import NO_DEPTH
from edgemap.runtime.frames.errors import CameraError
from edgemap.runtime.frames.reading import printable, read_bytes

SUFFIXES = frozenset({".jpg", ".jpeg", ".png", ".bmp", ".ppm", ".pgm", ".tif", ".tiff", ".webp"})
PIXEL_LIMIT = int(os.environ["OPENCV_IO_MAX_IMAGE_PIXELS"])  # set in edgemap's __init__ for OpenCV's decoders
APART_S = 0.02  # between the stamps of a picture and its depth
Depth = NDArray[np.float32]  # (H, W) metres along the optical axis, 0 where unknown


def natural_key(path: Path) -> list[tuple[int, int | str]]:
    """Sort key that puts `2.jpg` before `10.jpg`."""
    words = re.split(r"(\d+)", path.name)
    return [(0, int(word)) if word.isdecimal() else (1, word.lower()) for word in words if word]


def has_pictures(folder: Path) -> bool:
    """True where the folder exists and holds at least one picture file."""
    return folder.is_dir() and any(path.suffix.lower() in SUFFIXES for path in folder.iterdir())


def list_pictures(folder: Path) -> tuple[Path, ...]:
    """The folder's pictures in natural order of names. Raises CameraError where there are none."""
    if not folder.is_dir():
        raise CameraError(f"{printable(folder)}: no such folder")
    pictures = [path for path in folder.iterdir() if path.suffix.lower() in SUFFIXES and not path.name.startswith(".")]
    if odd := next((path.name for path in pictures if not path.name.isprintable()), None):
        raise CameraError(f"{printable(folder)}: a picture's name has characters that do not print: {odd!a}")
    if not pictures:
        inner = next((path for path in sorted(folder.iterdir()) if has_pictures(path) and path.name != "depth"), None)
        hint = f", but in {printable(inner)}" if inner else f" (looked for {', '.join(sorted(SUFFIXES))})"
        raise CameraError(f"{printable(folder)}: no pictures in it{hint}")
    return tuple(sorted(pictures, key=natural_key))


def first_folder(folder: Path, names: tuple[str, ...]) -> Path:
    """The first of the sub-folders that holds pictures, or else the folder itself."""
    return next((folder / name for name in names if has_pictures(folder / name)), folder)


class Levels:
    """Grey levels of a camera's 16-bit pictures, of which it uses 10, 12, 14 or all bits: by the brightest so far."""

    def __init__(self) -> None:
        self.bits = 8

    @property
    def notes(self) -> tuple[str, ...]:
        """What was scaled, as a line; none where nothing was."""
        text = f"pictures of 16 bits, of which {self.bits} are used: scaled to 8"
        return (text,) if self.bits > 8 else ()

    def eight_bits(self, picture: NDArray[np.uint16]) -> NDArray[np.uint8]:
        """The picture with its used bits scaled to 8."""
        used = int(picture.max(initial=0)).bit_length()
        self.bits = max(self.bits, used + used % 2)
        return (picture >> (self.bits - 8)).astype(np.uint8)


def read_picture(path: Path, levels: Levels | None = None) -> NDArray[np.uint8]:
    """One picture as BGR, (H, W, 3) uint8. levels: of its camera. Raises CameraError where it is missing, no picture,
    or cut short."""
    return decode_picture(read_bytes(path, CameraError), str(path), levels)


def decode_picture(data: bytes, name: str, levels: Levels | None = None) -> NDArray[np.uint8]:
    """A picture file's bytes as BGR, (H, W, 3) uint8. levels: of its camera, for pictures of 16 bits.

    Raises CameraError where they are not a picture, are truncated, or where the picture has too many pixels.
    """
    image = decoded(data, name, cv2.IMREAD_COLOR | cv2.IMREAD_ANYDEPTH)
    if image is not None and image.dtype == np.uint16:
        return (levels or Levels()).eight_bits(np.asarray(image, dtype=np.uint16))
    if image is not None and image.dtype != np.uint8:
        image = decoded(data, name, cv2.IMREAD_COLOR)
    if image is None:
        raise CameraError(f"{name}: not a picture that OpenCV reads ({len(data)} bytes)")
    return np.asarray(image, dtype=np.uint8)


def decoded(data: bytes, name: str, flags: int) -> MatLike | None:
    """Decodes a picture file's bytes with OpenCV and these flags; None where it cannot. Raises CameraError for
    truncated data or too many pixels.
    """
    if _is_cut_short(data):
        raise CameraError(f"{name}: picture is cut short ({len(data)} bytes)")
    try:
        return cv2.imdecode(np.frombuffer(data, np.uint8), flags)
    except cv2.error as error:
        if "validateInputImageSize" in str(error):
            raise CameraError(f"{name}: picture of more than {PIXEL_LIMIT:,} px, which are not decoded") from None
        return None


def _is_cut_short(data: bytes) -> bool:
    # Decoders fill what is missing with grey, without an error; the end markers show it.
    if data.startswith(b"\xff\xd8"):
        return data.rfind(b"\xff\xd9") < data.rfind(b"\xff\xda")
    return data.startswith(b"\x89PNG") and b"IEND" not in data


def video_frames(video: cv2.VideoCapture) -> Generator[tuple[NDArray[np.uint8], float], None, None]:
    """A video's pictures as BGR, (H, W, 3) uint8, with the file's stamps in seconds, as far as they can be decoded."""
    with suppress(cv2.error):
        while (read := video.read())[0]:
            yield np.asarray(read[1], dtype=np.uint8), video.get(cv2.CAP_PROP_POS_MSEC) / 1000.0


def readable_depth(path: Path) -> Depth | str:
    """A 16-bit picture of millimetres as depth, or why it cannot be read, since depth is optional."""
    try:
        image = decoded(read_bytes(path, CameraError), str(path), cv2.IMREAD_UNCHANGED)
    except CameraError as error:
        return str(error)
    if image is None or image.dtype != np.uint16 or image.ndim != 2:
        return f"{path}: not a depth picture (one channel of 16 bits, millimetres)"
    return image.astype(np.float32) / np.float32(1000.0)


# Names of pixel formats, of sensor_msgs/image_encodings and librealsense: channels, and how OpenCV makes BGR of them
# (None: it is BGR).
ENCODINGS: dict[str, tuple[int, int | None]] = {
    "bgr8": (3, None),
    "8UC3": (3, None),
    "rgb8": (3, cv2.COLOR_RGB2BGR),
    "bgra8": (4, cv2.COLOR_BGRA2BGR),
    "rgba8": (4, cv2.COLOR_RGBA2BGR),
    "mono8": (1, cv2.COLOR_GRAY2BGR),
    "8UC1": (1, cv2.COLOR_GRAY2BGR),
    "yuv422": (2, cv2.COLOR_YUV2BGR_UYVY),
    "uyvy": (2, cv2.COLOR_YUV2BGR_UYVY),
    "yuv422_yuy2": (2, cv2.COLOR_YUV2BGR_YUYV),
    "yuyv": (2, cv2.COLOR_YUV2BGR_YUYV),
}


def bgr_of(pixels: NDArray[np.uint8], encoding: str) -> NDArray[np.uint8]:
    """Pixels (H, W * channels) of one of `ENCODINGS` as BGR, (H, W, 3), a copy."""
    channels, conversion = ENCODINGS[encoding]
    image = pixels.reshape(len(pixels), -1, channels)
    if conversion is None:
        return image.copy()
    return np.asarray(cv2.cvtColor(np.ascontiguousarray(image), conversion), dtype=np.uint8)


class DepthBeside:
    """Depth of pictures, asked for by stamps that increase.

    pictures: stamp, and what decodes it (CameraError for a damaged one), in order of time. apart: greatest distance of
    a stamp from its picture's, in the stamps' unit.
    """

    def __init__(self, pictures: Generator[tuple[float, Callable[[], Any]], None, None], apart: float) -> None:
        self._pictures, self._apart = pictures, apart
        self._ahead = next(pictures, None)

    def at(self, stamp: float) -> Depth | str:
        """The depth picture of this stamp, (H, W) metres, or why there is none."""
        while self._ahead is not None and self._ahead[0] < stamp - self._apart:
            self._ahead = next(self._pictures, None)
        if self._ahead is None or self._ahead[0] > stamp + self._apart:
            return NO_DEPTH
        try:
            return self._ahead[1]()
        except CameraError as error:
            return str(error)

    def close(self) -> None:
        """Read nothing more."""
        self._pictures.close()
        self._ahead = None
