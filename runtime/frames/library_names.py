"""Checks file names for libraries that abort on names that are not UTF-8: OpenCV, PyAV, librealsense, engines.

Every path that such a library opens goes through `library_path`; `reading.printable` does the same for names that are
displayed. Python represents bytes of a file name that are not UTF-8 as surrogates (PEP 383), which OpenCV's bindings
turn into a null pointer.
"""

import os
from pathlib import Path

from edgemap.geometry.errors import EdgemapError
from edgemap.runtime.frames.reading import printable


class FileNameError(EdgemapError):
    """A file name that a library written in C++ cannot be given."""


def library_path(path: str | Path) -> str:
    """The path as UTF-8 text for a library, independent of the locale. Raises FileNameError where it is not UTF-8."""
    try:
        return os.fsencode(path).decode("utf-8")
    except UnicodeError:
        raise FileNameError(f"{printable(path)}: the name is not UTF-8, rename the file or its folder") from None
