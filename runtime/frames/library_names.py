"""Names on their way to libraries that end the process at what is not UTF-8: OpenCV, PyAV, librealsense, engines.

Every path that such a library opens goes through `library_path`; `reading.printable` is the same door for names that
are shown. Python keeps bytes of a file name that are no UTF-8 as halves of characters (surrogates, PEP 383), of
which OpenCV's bindings make a null pointer.
"""

import os
from pathlib import Path

from edgemap.geometry.errors import EdgemapError
from edgemap.runtime.frames.reading import printable


class FileNameError(EdgemapError):
    """A file name that a library written in C++ cannot be given."""


def library_path(path: str | Path) -> str:
    """The path as the UTF-8 text that a library opens, whatever the locale. Raises FileNameError where it is none."""
    try:
        return os.fsencode(path).decode("utf-8")
    except UnicodeError:
        raise FileNameError(f"{printable(path)}: the name is not UTF-8, rename the file or its folder") from None
