"""A run's pictures and results into a recording."""

from __future__ import annotations

from edgemap.geometry.objects.map_object import MapObject
from edgemap.runtime.recordings.recorder import Recorder
from edgemap.runtime.slam import StepResult


class RecordingSink:
    """Hands every step to a Recorder. Raises RecordingError where the disk does not take it."""

    def __init__(self, recorder: Recorder) -> None:
        self._recorder = recorder

    def write(self, result: StepResult, objects: list[MapObject]) -> None:
        """Record the picture and what was found in it."""
        self._recorder.results(self._recorder.picture(result.frame), result, objects)

    def fault(self, text: str) -> None:
        """Faults stand in run.json."""

    def close(self) -> None:
        """Finish the file."""
        self._recorder.close()
