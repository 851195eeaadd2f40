"""A text file that grows by complete lines: what the disk does not take now waits in memory."""

from collections import deque
from pathlib import Path

from edgemap.runtime.appending import append

MAX_WAITING = 200_000  # lines; an hour at 10 Hz with five sightings in each frame


class LineFile:
    """Lines go to the file when `flush` is called, all or none. dropped: lines lost because too many waited."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.dropped = 0
        self._waiting: deque[str] = deque()

    def append(self, line: str) -> None:
        """Take in a line, its end included."""
        if len(self._waiting) >= MAX_WAITING:
            self._waiting.popleft()
            self.dropped += 1
        self._waiting.append(line)

    def flush(self) -> None:
        """Write what waits. Raises DiskError and keeps it where the disk does not take all of it."""
        append(self.path, "".join(self._waiting).encode())
        self._waiting.clear()
