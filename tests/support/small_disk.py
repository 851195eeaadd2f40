"""A disk that is full."""

from contextlib import suppress
from pathlib import Path


def fill(disk: Path) -> Path:
    """Fill it up; the file to delete again."""
    hog = disk / "hog"
    with hog.open("wb", buffering=0) as stream, suppress(OSError):
        while True:
            stream.write(bytes(512))
    return hog
