"""Pictures on disk: which ones a folder holds, in what order, and reading one with its damage noticed."""

import re
from pathlib import Path

import cv2
import numpy as np
from cv2.typing import MatLike
from numpy.typing import NDArray

from edgemap.runtime.drives.picture_size import PIXEL_LIMIT, SIDE_LIMIT, picture_size
from edgemap.runtime.errors import CameraError
from edgemap.runtime.quiet import quietly
from edgemap.runtime.reading import read_bytes

PICTURE_BYTES = 256 << 20

SUFFIXES = frozenset({".jpg", ".jpeg", ".png", ".bmp", ".ppm", ".pgm", ".tif", ".tiff", ".webp"})


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
        raise CameraError(f"{folder}: no such folder")
    pictures = [path for path in folder.iterdir() if path.suffix.lower() in SUFFIXES and not path.name.startswith(".")]
    if odd := next((path.name for path in pictures if not path.name.isprintable()), None):
        raise CameraError(f"{folder}: a picture's name has characters that do not print: {odd!a}")
    if not pictures:
        raise CameraError(f"{folder}: no pictures in it (looked for {', '.join(sorted(SUFFIXES))})")
    return tuple(sorted(pictures, key=natural_key))


def first_folder(folder: Path, names: tuple[str, ...]) -> Path:
    """The first of the sub-folders that holds pictures, or else the folder itself."""
    if not folder.is_dir():
        raise CameraError(f"{folder}: no such folder")
    return next((folder / name for name in names if has_pictures(folder / name)), folder)


def read_picture(path: Path) -> NDArray[np.uint8]:
    """One picture as BGR, (H, W, 3) uint8. Raises CameraError where it is missing, no picture, or cut short."""
    return decode_picture(read_bytes(path, PICTURE_BYTES, CameraError), str(path))


def decode_picture(data: bytes, name: str) -> NDArray[np.uint8]:
    """A picture file's bytes as BGR, (H, W, 3) uint8.

    Raises CameraError where they are no picture, cut short, or where the picture has too many pixels: the file's header
    says how many before anything is decoded.
    """
    image = decoded(data, name, cv2.IMREAD_COLOR)
    if image is None:
        raise CameraError(f"{name}: not a picture that OpenCV reads ({len(data)} bytes)")
    return np.asarray(image, dtype=np.uint8)


def decoded(data: bytes, name: str, flags: int) -> MatLike | None:
    """What OpenCV reads in a picture file's bytes by its flags; None where that is nothing. Raises CameraError for what
    is cut short or has too many pixels."""
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
