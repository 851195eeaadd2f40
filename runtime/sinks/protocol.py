"""Where results go: a sink gets what `step` returned and never reaches into the pipeline."""

from typing import Protocol

from edgemap.geometry.objects.map_object import MapObject
from edgemap.runtime.slam import StepResult


class Sink(Protocol):
    """Takes results while a run lasts: a file, a page, a publisher. All calls come from the run's own thread.

    To write one: give it a `name` and the three methods; raise whatever goes wrong. `SinkGroup` holds the rule for
    every sink: one that raises never ends the run. Its failure is reported to all sinks once, as a fault with its name;
    later results are offered all the same, and the first one that it takes again is reported too. So a sink
    - never waits: what may block (a network, a slow disk) goes to a thread or a bounded queue of its own;
    - raises an EdgemapError of one line with what, where and the numbers (an unknown error keeps its traceback in the
      log), in every `write` that finds it still failing, and does not report the fault itself;
    - recovers inside `write` (connects again, opens the file again), at its own pace;
    - keeps references and never changes what it is given.

    name: what messages call it, as "run folder" or "recording drive.mcap".
    """

    name: str

    def write(self, result: StepResult, objects: list[MapObject]) -> None:
        """Take in one step's result; `objects` is the map after the step. May raise anything."""
        ...

    def fault(self, text: str) -> None:
        """Take note of something that went wrong, in one line. What it raises is ignored."""
        ...

    def close(self) -> None:
        """Finish; whatever was gathered is safe afterwards. May be called twice.

        Raises where something that was to be kept is lost; that ends the command with the error's exit code, after
        every other sink is closed. A publisher that only loses its listener raises nothing.
        """
        ...
