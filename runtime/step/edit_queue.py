"""Edits on their way into a run: asked for by any thread, taken between two steps, recorded as inputs."""

from collections import deque
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import Future
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import msgspec
from msgspec import Meta

from edgemap.geometry.map_object import MapObject
from edgemap.geometry.objects.annotations import MAXIMUM_CORNERS, Annotations
from edgemap.geometry.objects.events import Edit, EditError, EditKind
from edgemap.runtime.frames.disk import LineFile
from edgemap.runtime.frames.errors import DiskError
from edgemap.runtime.frames.faults import Fault, FaultKind
from edgemap.runtime.frames.limits import QUEUE
from edgemap.runtime.frames.reading import (
    HIDDEN,
    Coordinate,
    Size,
    Strict,
    decode_json,
    error_line,
    read_text,
)
from edgemap.runtime.motion.odometry.protocol import FARTHEST_M
from edgemap.runtime.step.map_records import Point, Yaw
from edgemap.runtime.step.mapper import Mapper

Sigma = Annotated[float, Meta(gt=0.0, lt=FARTHEST_M)]  # m or rad
Text = Annotated[str, Meta(max_length=200, pattern=rf"\A[^{HIDDEN}]*\Z")]
Edited = Callable[[list[MapObject], Annotations], None]


class _Line(Strict, omit_defaults=True):
    """A line of edits.jsonl. frames: steps done before the edit."""

    frames: Annotated[int, Meta(ge=0, le=1 << 40)]
    do: EditKind
    id: Text = ""
    name: Text = ""
    on: bool = True
    into: Text = ""
    corners_m: Annotated[tuple[Point, ...], Meta(max_length=MAXIMUM_CORNERS)] = ()
    label: Text = ""
    place_m: Point | None = None
    size_m: tuple[Size, Size, Size] | None = None
    yaw_rad: Yaw | None = None
    pose: tuple[Coordinate, Coordinate, Yaw] | None = None
    sigmas: tuple[Sigma, Sigma, Sigma] | None = None


class Edits:
    """A run's edits. path: edits.jsonl, to which each edit is written when it is applied. recorded: (steps done, edit)
    of an earlier run, applied at the same steps again. recorders: called with each line of edits.jsonl. listeners:
    called whenever the map was edited, before an edit's sender has its answer: what was answered is on disk.
    """

    def __init__(self, path: Path | None = None, recorded: Sequence[tuple[int, Edit]] = ()) -> None:
        self.listeners: list[Edited] = []
        self._unsaved: DiskError | None = None  # of the newest edits
        self.recorders: list[Callable[[str], None]] = []
        self._log = LineFile(path) if path else None
        self._recorded = deque(recorded)
        self._waiting: deque[tuple[Edit, Future[str]]] = deque()
        self._ended = False

    def submit(self, edit: Edit) -> Future[str]:
        """Ask for an edit, from any thread; the id of its object or zone once it is done. The future raises EditError
        where the map does not allow it."""
        future: Future[str] = Future()
        if len(self._waiting) >= QUEUE:
            future.set_exception(EditError(f"{QUEUE} edits are waiting already"))
        else:
            self._waiting.append((edit, future))
        if self._ended:
            self.end()
        return future

    def end(self) -> None:
        """Refuses the edits that wait and all later ones: the run has ended."""
        self._ended = True
        while self._waiting:
            _, future = self._waiting.popleft()
            if future.set_running_or_notify_cancel():
                future.set_exception(EditError("the run has ended"))

    def apply(self, mapper: Mapper, frames: int) -> list[Fault]:
        """Take what is due, on the run's thread and between two steps. frames: steps done so far. Returns the faults of
        recorded edits and listeners."""
        recorded, done = list[tuple[Edit, Future[str]]](), list[tuple[Future[str], str]]()
        while self._recorded and self._recorded[0][0] <= frames:
            recorded.append((self._recorded.popleft()[1], Future()))
        waiting = [self._waiting.popleft() for _ in range(len(self._waiting))]
        # Without those whose sender has stopped waiting.
        for edit, future in (*recorded, *(one for one in waiting if one[1].set_running_or_notify_cancel())):
            try:
                line = _line_of(edit, frames)
                done.append((future, mapper.edit(edit)))
                self._note(line)
            except EditError as error:
                future.set_exception(error)
        refused = [(edit, future.exception()) for edit, future in recorded if future.done()]
        failed = [Fault(FaultKind.EDIT, f"recorded edit {edit.do} {edit.id!r}: {error}") for edit, error in refused]
        if done:
            failed += self._report(mapper)
        for future, identity in done:  # last, so that the sender reads the edited map
            future.set_result(identity)
        return failed

    def close(self, mapper: Mapper) -> None:
        """Writes the edits that the disk has not taken. Raises DiskError."""
        self.end()
        if self._unsaved is not None and self._report(mapper) and self._unsaved is not None:
            raise self._unsaved
        if self._log is not None and self._log.waiting:
            self._log.flush()

    def _report(self, mapper: Mapper) -> list[Fault]:
        """Calls all listeners; their errors do not end the run, as those of sinks."""
        self._unsaved, failed = None, list[Fault]()
        for listener in self.listeners:
            try:
                listener(mapper.objects(), mapper.annotations())
            except Exception as error:  # of anybody's code
                failed.append(Fault(FaultKind.EDIT, f"edited map: {error_line(error)}"))
                self._unsaved = error if isinstance(error, DiskError) else self._unsaved
        return failed

    def _note(self, line: str) -> None:
        """Record it; a full disk gets it with the next one, or at the end."""
        for record in self.recorders:
            record(line)
        if self._log is not None:
            self._log.append(line + "\n")
            with suppress(DiskError):
                self._log.flush()


def _line_of(edit: Edit, frames: int) -> str:
    """The edit as edits.jsonl has it. Raises EditError for one that could not be read again."""
    try:
        line = msgspec.json.encode(_Line(frames=frames, **asdict(edit))).decode()
    except UnicodeError:
        raise EditError(f"edit {edit.do}: text that is not Unicode") from None
    read_edits([line], f"edit {edit.do}")
    return line


def load_edits(path: Path) -> list[tuple[int, Edit]]:
    """An edits.jsonl: (steps done, edit), in order. Raises EditError in one line."""
    return read_edits(read_text(path, EditError).splitlines(), str(path))


def read_edits(lines: Iterable[str], source: str) -> list[tuple[int, Edit]]:
    """Parses the lines of a file of edits as `load_edits` does. source: for messages."""
    edits = list[tuple[int, Edit]]()
    for number, line in enumerate(lines, 1):
        values = msgspec.structs.asdict(decode_json(line, _Line, f"{source}:{number}", EditError))
        edits.append((values.pop("frames"), Edit(**values)))
    return edits
