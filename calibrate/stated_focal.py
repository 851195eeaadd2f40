"""The focal length in the metadata of a picture or a video, as phones and cameras write it."""

import math
from importlib.util import find_spec
from pathlib import Path

from edgemap.runtime.frames.reading import library_path

PICTURE_KINDS = (".jpg", ".jpeg", ".png", ".tif", ".tiff")
VIDEO_KEYS = ("com.apple.quicktime.camera.focal_length.35mm_equivalent",)


def stated_focal_px(path: Path, width: int, height: int) -> tuple[float, str] | None:
    """Focal length in px for pictures of this size, and the file that states it; None where no file does.

    path: a picture, a folder of them, or a video. Computed from the 35 mm equivalent by the diagonal
    (CIPA DCG-001). For a video it is somewhat short, as filming crops the sensor.
    """
    film_mm, source = None, ""
    if path.is_dir():
        path = next((one for one in sorted(path.iterdir()) if one.suffix.lower() in PICTURE_KINDS), path)
    if path.suffix.lower() in PICTURE_KINDS and find_spec("PIL"):
        film_mm, source = _of_picture(path), "EXIF"
    elif path.is_file() and find_spec("av"):
        film_mm, source = _of_video(path), "the video's metadata"
    if film_mm is None or not 8.0 <= film_mm <= 400.0:  # a lens that there is; 0: unknown
        return None
    return film_mm / math.hypot(36.0, 24.0) * math.hypot(width, height), source


def _of_picture(path: Path) -> float | None:
    from PIL import ExifTags, Image

    try:
        with Image.open(path) as picture:
            exif = picture.getexif().get_ifd(ExifTags.IFD.Exif)
            return _number(exif.get(ExifTags.Base.FocalLengthIn35mmFilm))
    except (OSError, ValueError, SyntaxError, KeyError, Image.DecompressionBombError):  # of damaged files
        return None


def _of_video(path: Path) -> float | None:
    import av
    from av.error import FFmpegError

    try:
        with av.open(library_path(path)) as container:
            tags = [container.metadata, *(stream.metadata for stream in container.streams)]
    except (FFmpegError, OSError, ValueError):
        return None
    return next((_number(tag[key]) for tag in tags for key in VIDEO_KEYS if key in tag), None)


def _number(value: object) -> float | None:
    try:
        number = float(str(value))
    except ValueError:
        return None
    return number if math.isfinite(number) else None
