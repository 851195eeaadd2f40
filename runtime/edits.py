"""Edits on their way into a run: asked for by any thread, taken between two steps, recorded as inputs."""

import json
from collections import deque
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import Future
from contextlib import suppress
from dataclasses import fields
from pathlib import Path
from typing import Annotated, Any, get_args

import msgspec
from msgspec import Meta

from edgemap.geometry.objects.edits import MAXIMUM_CORNERS, Annotations, Edit, EditError, EditKind
from edgemap.geometry.objects.map_object import MapObject
from edgemap.runtime.disk import LineFile
from edgemap.runtime.errors import DiskError
from edgemap.runtime.mapper import Mapper
from edgemap.runtime.reading import HIDDEN, Coordinate, Strict, decode_json, error_line, read_text

MAXIMUM_WAITING = 100
FILE_BYTES = 16 << 20
KINDS = get_args(EditKind)
Text = Annotated[str, Meta(max_length=200, pattern=rf"\A[^{HIDDEN}]*\Z")]
Edited = Callable[[list[MapObject], Annotations], None]


class _Line(Strict):
    """A line of edits.jsonl. frames: steps done before the edit."""

    frames: Annotated[int, Meta(ge=0, le=1 << 40)]
    do: str
    id: Text = ""
    name: Text = ""
    on: bool = True
    into: Text = ""
    corners_m: Annotated[list[tuple[Coordinate, Coordinate]], Meta(max_length=MAXIMUM_CORNERS)] = msgspec.field(
        default_factory=list
    )


class Edits:
    """A run's edits. path: edits.jsonl, to which each one is written as it is taken. recorded: (steps done, edit) of
    an earlier run, taken at the same steps again. recorders: called with each line of edits.jsonl."""

    def __init__(self, path: Path | None = None, recorded: Sequence[tuple[int, Edit]] = ()) -> None:
        self.listeners: list[Edited] = []
        self.recorders: list[Callable[[str], None]] = []
        self._log = LineFile(path) if path else None
        self._recorded = deque(recorded)
        self._waiting: deque[tuple[Edit, Future[str]]] = deque()

    def submit(self, edit: Edit) -> Future[str]:
        """Ask for an edit, from any thread; the id of its object or zone once it is done. The future raises EditError
        where the map does not allow it."""
        future: Future[str] = Future()
        if len(self._waiting) >= MAXIMUM_WAITING:
            future.set_exception(EditError(f"{MAXIMUM_WAITING} edits are waiting already"))
        else:
            self._waiting.append((edit, future))
        return future

    def apply(self, mapper: Mapper, frames: int) -> list[str]:
        """Take what is due, on the run's thread and between two steps. frames: steps done so far. Returns what recorded
        edits and listeners failed at, in a line each."""
        failed: list[str] = []
        answers: list[tuple[Future[str], str]] = []
        changed = False
        while self._recorded and self._recorded[0][0] <= frames:
            edit = self._recorded.popleft()[1]
            try:
                mapper.edit(edit)
            except EditError as error:
                failed.append(f"recorded edit {edit.do} {edit.id!r}: {error}")
                continue
            self._note(edit, frames)
            changed = True
        while self._waiting:
            edit, future = self._waiting.popleft()
            if not future.set_running_or_notify_cancel():  # nobody waits for it any more
                continue
            try:
                answers.append((future, mapper.edit(edit)))
            except EditError as error:
                future.set_exception(error)
                continue
            self._note(edit, frames)
        if changed or answers:
            for listener in self.listeners:
                try:
                    listener(mapper.objects(), mapper.annotations())
                except Exception as error:  # as with sinks: whoever listens, the run goes on
                    failed.append(f"edited map: {error_line(error)}")
        for future, answer in answers:  # last, so that whoever waited finds the edited map
            future.set_result(answer)
        return failed

    def _note(self, edit: Edit, frames: int) -> None:
        """Record it; a full disk gets it with the next one, and the run folder reports it."""
        line = json.dumps({"frames": frames} | _changed_fields(edit))
        for record in self.recorders:
            record(line)
        if self._log is not None:
            self._log.append(line + "\n")
            with suppress(DiskError):
                self._log.flush()


def load_edits(path: Path) -> list[tuple[int, Edit]]:
    """An edits.jsonl: (steps done, edit), in order. Raises EditError in one line."""
    return read_edits(read_text(path, FILE_BYTES, EditError).splitlines(), str(path))


def read_edits(lines: Iterable[str], source: str) -> list[tuple[int, Edit]]:
    """As `load_edits`, of its lines. source: for messages."""
    found = []
    for number, line in enumerate(lines, 1):
        record = decode_json(line, _Line, f"{source}:{number}", EditError)
        if record.do not in KINDS:
            raise EditError(f"{source}:{number}: no edit is called {record.do!r} (known: {', '.join(KINDS)})")
        values: dict[str, Any] = {item.name: getattr(record, item.name) for item in fields(Edit)}
        values["corners_m"] = tuple(record.corners_m)
        found.append((record.frames, Edit(**values)))
    return found


def _changed_fields(edit: Edit) -> dict[str, Any]:
    """An edit's fields, without those that say nothing."""
    values = {item.name: getattr(edit, item.name) for item in fields(Edit)}
    return {"do": edit.do} | {name: value for name, value in values.items() if value != getattr(Edit(edit.do), name)}
