"""Atomic writes: a file is replaced as a whole, or extended by complete records, even when the disk fails."""

import fcntl
import os
from collections import deque
from collections.abc import Callable, Iterable
from pathlib import Path

from edgemap.runtime.frames.errors import DiskError, RunFolderError

SAVE_EVERY_S = 0.75  # of stream between two saved maps: with two frames at 10 Hz on top, less than 1 s is lost
MAX_WAITING = 200_000  # lines; an hour at 10 Hz with five sightings in each frame


def append(path: Path, data: bytes, create: bool = True) -> None:
    """Appends all of it or nothing. create: whether to create a missing file. Raises DiskError where nothing was
    written.
    """
    flags = os.O_WRONLY | os.O_APPEND | os.O_CLOEXEC | os.O_NOFOLLOW | (os.O_CREAT if create else 0)
    try:
        with open(path, "ab", buffering=0, opener=lambda name, _: os.open(name, flags, 0o644)) as file:
            start, left = file.seek(0, os.SEEK_END), memoryview(data)
            try:
                while left:
                    left = left[file.write(left) :]
            except OSError:
                file.truncate(start)
                raise
    except OSError as error:
        raise DiskError(f"{path}: cannot be written ({error.strerror})") from None


def write_atomically(path: Path, text: str | bytes | Callable[[], Iterable[bytes]]) -> None:
    """Replace a file's content at once: readers and a power cut see the old text or the new one, never a part.

    text: or what gives it block by block. Raises DiskError where the folder does not take it.
    """
    whole = text.encode("utf-8", "backslashreplace") if isinstance(text, str) else text
    temporary = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        temporary.unlink(missing_ok=True)  # of a killed process that had this number
        try:
            with temporary.open("xb") as file:
                file.writelines(whole() if callable(whole) else (whole,))
                file.flush()
                os.fsync(file.fileno())
            temporary.replace(path)
        except BaseException:
            temporary.unlink(missing_ok=True)
            raise
        folder = os.open(path.parent, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
        try:
            os.fsync(folder)  # else a power cut may undo the renaming
        finally:
            os.close(folder)
    except OSError as error:
        raise DiskError(f"{path}: cannot be written ({error.strerror})") from None


def make_folder(folder: Path, parents: bool = True) -> Path:
    """Makes a folder where it is missing, and its parents if asked for; the folder. Raises DiskError."""
    try:
        folder.mkdir(parents=parents, exist_ok=parents)
    except OSError as error:
        raise DiskError(f"{folder}: {'cannot be written' if parents else 'is gone'} ({error.strerror})") from None
    return folder


def lock_folder(folder: Path, held: str, parents: bool = True) -> int:
    """An open handle of a folder, made as by `make_folder`, that no other run holds.

    Raises RunFolderError (held: its words), or DiskError.
    """
    make_folder(folder, parents)
    try:
        handle = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            os.close(handle)
            raise RunFolderError(f"{folder}: {held}") from None
    except OSError as error:
        raise DiskError(f"{folder}: cannot be locked ({error.strerror})") from None
    return handle


class LineFile:
    """Lines go to the file when `flush` is called, all or none. dropped: lines dropped because the queue was full."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.dropped = 0
        self._waiting: deque[str] = deque()

    @property
    def waiting(self) -> bool:
        """Whether there are lines that are not in the file."""
        return bool(self._waiting)

    def append(self, line: str) -> None:
        """Queues a line, newline included."""
        if len(self._waiting) >= MAX_WAITING:
            self._waiting.popleft()
            self.dropped += 1
        self._waiting.append(line)

    def flush(self) -> None:
        """Writes the queued lines. Raises DiskError and keeps them where the disk cannot take all of them."""
        append(self.path, "".join(self._waiting).encode())
        self._waiting.clear()
