"""Bytes at the end of a file, all of them or none: a disk that fails in the middle leaves the file as it was."""

import os
from pathlib import Path

from edgemap.runtime.errors import DiskError


def append(path: Path, data: bytes, create: bool = True) -> None:
    """Write all of it. create: make the file where it is not there. Raises DiskError where nothing was written."""
    flags = os.O_WRONLY | os.O_APPEND | os.O_CLOEXEC | os.O_NOFOLLOW | (os.O_CREAT if create else 0)
    try:
        handle = os.open(path, flags, 0o644)
        try:
            start = os.lseek(handle, 0, os.SEEK_END)
            try:
                left = memoryview(data)
                while left:
                    left = left[os.write(handle, left) :]
            except OSError:
                os.ftruncate(handle, start)
                raise
        finally:
            os.close(handle)
    except OSError as error:
        raise DiskError(f"{path}: cannot be written ({error.strerror})") from None
