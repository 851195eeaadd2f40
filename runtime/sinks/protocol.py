"""Where results go: a sink gets what `step` returned and never reaches into the pipeline."""

from __future__ import annotations

from typing import Protocol

from edgemap.geometry.objects.map_object import MapObject
from edgemap.runtime.slam import StepResult


class Sink(Protocol):
    """Takes results while a run lasts. `objects` is the map after the step."""

    def write(self, result: StepResult, objects: list[MapObject]) -> None:
        """Take in one step's result."""
        ...

    def fault(self, text: str) -> None:
        """Take note of something that went wrong, in one line."""
        ...

    def close(self) -> None:
        """Finish; whatever was gathered is safe afterwards. May be called twice."""
        ...
