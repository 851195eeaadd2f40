"""Pictures, colour and depth: those that a folder holds, files with their size and damage noticed, raw pixels, and
depth in order of time."""

import re
import struct
from collections.abc import Callable, Generator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from cv2.typing import MatLike
from numpy.typing import NDArray

from edgemap.runtime.frames.errors import CameraError
from edgemap.runtime.frames.quiet import quietly
from edgemap.runtime.frames.reading import printable, read_bytes

PICTURE_BYTES = 256 << 20

SUFFIXES = frozenset({".jpg", ".jpeg", ".png", ".bmp", ".ppm", ".pgm", ".tif", ".tiff", ".webp"})
PIXEL_LIMIT = 1 << 26  # 67 million: 200 MB as BGR, and decoders need as much again
SIDE_LIMIT = 65_536
_PNM = re.compile(rb"P[2356]\s(?:\s|#[^\n]*\n)*(\d{1,9})\s(?:\s|#[^\n]*\n)*(\d{1,9})\s")
_JPEG_SIZES = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}
_TIFF_TYPES = {3: "H", 4: "I"}  # SHORT, LONG
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
    if not folder.is_dir():
        raise CameraError(f"{printable(folder)}: no such folder")
    return next((folder / name for name in names if has_pictures(folder / name)), folder)


def read_picture(path: Path) -> NDArray[np.uint8]:
    """One picture as BGR, (H, W, 3) uint8. Raises CameraError where it is missing, no picture, or cut short."""
    return decode_picture(read_bytes(path, PICTURE_BYTES, CameraError), str(path))


def decode_picture(data: bytes, name: str) -> NDArray[np.uint8]:
    """A picture file's bytes as BGR, (H, W, 3) uint8.

    Raises CameraError where they are not a picture, are truncated, or where the picture has too many pixels; the header
    is checked before anything is decoded.
    """
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
    size = picture_size(data)
    if size is not None and (size[0] * size[1] > PIXEL_LIMIT or max(size) > SIDE_LIMIT):
        raise CameraError(f"{name}: picture of {size[0]}x{size[1]} px, at most {PIXEL_LIMIT:,} px are decoded")
    try:
        with quietly():
            return cv2.imdecode(np.frombuffer(data, np.uint8), flags) if size is not None else None
    except cv2.error:
        return None


def _is_cut_short(data: bytes) -> bool:
    # Decoders fill what is missing with grey, without an error; the end markers show it.
    if data.startswith(b"\xff\xd8"):
        return data.rfind(b"\xff\xd9") < data.rfind(b"\xff\xda")
    return data.startswith(b"\x89PNG") and b"IEND" not in data


def picture_size(data: bytes) -> tuple[int, int] | None:
    """(width, height) in px of a PNG, JPEG, BMP, PNM, TIFF or WebP file; None for anything else, or where it is cut."""
    try:
        if data.startswith(b"\x89PNG\r\n\x1a\n") and data[12:16] == b"IHDR":
            return struct.unpack_from(">II", data, 16)
        if data.startswith(b"\xff\xd8"):
            return _jpeg(data)
        if data.startswith(b"BM"):
            return _bmp(data)
        if data.startswith((b"II*\0", b"MM\0*")):
            return _tiff(data, "<" if data.startswith(b"II") else ">")
        if data.startswith(b"RIFF") and data[8:12] == b"WEBP":
            return _webp(data)
        found = _PNM.match(data[:4096])
        return (int(found[1]), int(found[2])) if found else None
    except struct.error:  # cut short
        return None


def _jpeg(data: bytes) -> tuple[int, int] | None:
    """From the largest frame header: a file may hold more than one."""
    at, largest = 2, None
    while at + 4 <= len(data) and data[at] == 0xFF:
        kind = data[at + 1]
        if kind == 0xFF:  # fill
            at += 1
            continue
        if kind == 0xDA:  # the picture's own data
            break
        if kind in _JPEG_SIZES:
            height, width = struct.unpack_from(">HH", data, at + 5)
            largest = max(largest or (0, 0), (width, height), key=lambda size: size[0] * size[1])
        bare = kind == 0x01 or 0xD0 <= kind <= 0xD8
        at += 2 if bare else 2 + struct.unpack_from(">H", data, at + 2)[0]
    return largest


def _bmp(data: bytes) -> tuple[int, int]:
    (size,) = struct.unpack_from("<I", data, 14)
    width, height = struct.unpack_from("<HH" if size == 12 else "<ii", data, 18)
    return abs(width), abs(height)


def _tiff(data: bytes, order: str) -> tuple[int, int] | None:
    (at,) = struct.unpack_from(f"{order}I", data, 4)
    (count,) = struct.unpack_from(f"{order}H", data, at)
    sides: dict[int, int] = {}
    for entry in range(at + 2, at + 2 + 12 * min(count, 1000), 12):
        tag, kind = struct.unpack_from(f"{order}HH", data, entry)
        if tag in (256, 257) and kind in _TIFF_TYPES:
            sides[tag] = max(sides.get(tag, 0), struct.unpack_from(order + _TIFF_TYPES[kind], data, entry + 8)[0])
    return (sides[256], sides[257]) if len(sides) == 2 else None


def _webp(data: bytes) -> tuple[int, int] | None:
    if data[12:16] == b"VP8X":
        width, height = (int.from_bytes(data[at : at + 3], "little") + 1 for at in (24, 27))
        return width, height
    if data[12:16] == b"VP8L":
        (bits,) = struct.unpack_from("<I", data, 21)
        return (bits & 0x3FFF) + 1, (bits >> 14 & 0x3FFF) + 1
    if data[12:16] == b"VP8 ":
        width, height = struct.unpack_from("<HH", data, 26)
        return width & 0x3FFF, height & 0x3FFF
    return None


def read_depth(path: Path) -> Depth:
    """A 16-bit picture of millimetres. Raises CameraError."""
    image = decoded(read_bytes(path, PICTURE_BYTES, CameraError), str(path), cv2.IMREAD_UNCHANGED)
    if image is None or image.dtype != np.uint16 or image.ndim != 2:
        raise CameraError(f"{path}: not a depth picture (one channel of 16 bits, millimetres)")
    return image.astype(np.float32) / np.float32(1000.0)


def readable_depth(path: Path | None) -> Depth | None:
    """The same; None where it cannot be read, since depth is optional."""
    try:
        return None if path is None else read_depth(path)
    except CameraError:
        return None


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
    """Pixels (H, W * channels) of one of `ENCODINGS` as BGR, (H, W, 3), their own copy."""
    channels, conversion = ENCODINGS[encoding]
    image = pixels.reshape(len(pixels), -1, channels)
    if conversion is None:
        return image.copy()
    return np.asarray(cv2.cvtColor(np.ascontiguousarray(image), conversion), dtype=np.uint8)


class DepthBeside:
    """Depth pictures beside pictures, asked for by stamps that increase; damaged ones are skipped, since depth is
    optional.

    pictures: stamp, and what decodes it (CameraError for a damaged one), in order of time. apart: greatest distance of
    a stamp from its picture's, in the stamps' unit.
    """

    def __init__(self, pictures: Generator[tuple[float, Callable[[], Any]], None, None], apart: float) -> None:
        self._pictures, self._apart = pictures, apart
        self._ahead = next(pictures, None)

    def at(self, stamp: float) -> Depth | None:
        """The depth picture of this stamp, (H, W) metres; None where there is none."""
        while self._ahead is not None and self._ahead[0] < stamp - self._apart:
            self._ahead = next(self._pictures, None)
        if self._ahead is None or self._ahead[0] > stamp + self._apart:
            return None
        try:
            return self._ahead[1]()
        except CameraError:
            return None

    def close(self) -> None:
        """Read nothing more."""
        self._pictures.close()
        self._ahead = None
