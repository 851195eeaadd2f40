"""A run's pictures and results into a recording."""

from collections.abc import Callable
from contextlib import suppress

from edgemap.geometry.objects.map_object import MapObject
from edgemap.runtime.errors import DiskError, RecordingError
from edgemap.runtime.recordings.recorder import Recorder
from edgemap.runtime.slam import StepResult


class RecordingSink:
    """Hands every step to a Recorder. start: makes it, and makes it again where the file vanished with its folder.

    Raises DiskError where the disk does not take it: those results are missing from the recording, which goes on in the
    same file once the disk takes it again.
    """

    def __init__(self, start: Callable[[], Recorder]) -> None:
        self._start, self._recorder = start, start()
        self.name = f"recording {self._recorder.path.name}"

    def write(self, result: StepResult, objects: list[MapObject]) -> None:
        """Record the picture and what was found in it."""
        path = self._recorder.path
        if path.parent.is_dir() and not path.exists():
            self._recorder = self._start()
        self._recorder.results(self._recorder.picture(result.frame), result, objects)

    def edit(self, line: str) -> None:
        """Record an edit as a line of edits.jsonl; one that the disk does not take, or that comes after the end of the
        file, is missing in a replay."""
        with suppress(DiskError, RecordingError):
            self._recorder.edit(line)

    def fault(self, text: str) -> None:
        """Faults stand in run.json."""

    def close(self) -> None:
        """Finish the file. Raises DiskError where its end cannot be written: it is good up to its last whole chunk."""
        self._recorder.close()
