"""Sinks of a run's results. A sink that fails is reported, and the run continues."""

import logging
from collections.abc import Sequence
from dataclasses import replace
from typing import Protocol

from edgemap.geometry.errors import EdgemapError
from edgemap.geometry.map_object import MapObject
from edgemap.runtime.frames.errors import CameraFault, CameraLostError
from edgemap.runtime.frames.faults import Fault, FaultKind
from edgemap.runtime.frames.reading import THEIRS, error_line, printable
from edgemap.runtime.step.slam import StepResult

_log = logging.getLogger(__name__)


def raised() -> tuple[type[BaseException], ...]:
    """What a sink may raise: one with an event loop is cancelled with it. Imported only then: a run needs none."""
    from asyncio import CancelledError

    return (*THEIRS, CancelledError)


class Sink(Protocol):
    """Takes results while a run lasts: a file, a page, a publisher. All calls come from the run's thread.

    To write one: derive from this class, give it a `name` and the methods that it needs; raise any error. `SinkGroup`
    implements the rule for every sink: an exception never ends the run. Its failure is reported to all sinks once, as a
    fault with its name; later results are offered all the same, and the first one that it takes again is reported too.
    So a sink
    - never waits: what may block (a network, a slow disk) goes to a thread or a bounded queue of its own;
    - raises an EdgemapError of one line with what, where and the numbers (an unknown error keeps its traceback in the
      log), in every `write` that finds it still failing, and does not report the fault itself;
    - recovers inside `write` (connects again, opens the file again), at its own pace;
    - keeps references and never changes what it is given.

    name: what messages call it, as "run folder" or "recording drive.mcap". A sink with a true attribute `for_caller`
    writes for the user who started the run; it does not receive the failure that ends the run, which the caller
    reports. A sink with a method `last(result, objects)` receives the boxes that came after the last frame, and the map
    with them; `result` is of that frame again.
    """

    name: str

    def write(self, result: StepResult, objects: list[MapObject]) -> None:
        """Receives one step's result; `objects` is the map after the step. May raise anything."""

    def fault(self, fault: Fault) -> None:
        """Receives each fault of the run, those of a step after its result; run.json holds them in any case. Its
        exceptions are ignored."""

    def close(self) -> None:
        """Finish; whatever was gathered is safe afterwards. May be called twice.

        Raises where something that was to be kept is lost; that ends the command with the error's exit code, after
        every other sink is closed. A publisher that only loses its listener raises nothing.
        """


class SinkGroup:
    """All sinks of a run as one that never fails before `close`. See `Sink` for its guarantees."""

    def __init__(self, sinks: Sequence[Sink]) -> None:
        self._sinks = sinks
        self._outages: dict[int, float] = {}  # stamps since which sinks fail, by their place
        self._since: list[Fault] = []  # outside of a step, since `faults_since` was asked

    def write(self, result: StepResult, objects: list[MapObject]) -> None:
        """Offer a step's result to every sink, then its faults."""
        stamp_s = result.frame.stamp_s
        for place, sink in enumerate(self._sinks):
            try:
                sink.write(result, objects)
            except raised() as error:  # a sink may raise anything; mapping continues
                if place not in self._outages:
                    self._outages[place] = stamp_s
                    self.fault(Fault(FaultKind.OUTPUT, f"{sink.name}: {_line(error)}; the run goes on"))
                continue
            if place in self._outages:
                away_s = stamp_s - self._outages.pop(place)
                text = f"{sink.name}: works again after {away_s:.1f} s of stream"
                self.fault(Fault(FaultKind.OUTPUT_RESTORED, text))
        for fault in result.observed.faults:
            self._report(fault)

    def last(self, result: StepResult, objects: list[MapObject]) -> None:
        """Offer the boxes that came after the last frame to the sinks that take them."""
        for sink in self._sinks:
            try:
                getattr(sink, "last", lambda *_: None)(result, objects)
            except raised() as error:  # as in `write`
                self.fault(Fault(FaultKind.OUTPUT, f"{sink.name}: {_line(error)}"))

    def fault(self, fault: Fault) -> None:
        """Report a fault outside of a step to every sink; it is in the next result too."""
        self._since.append(fault)
        self._report(fault)

    def faults_since(self) -> list[Fault]:
        """The faults outside of a step since the last call."""
        faults, self._since = self._since, []
        return faults

    def _report(self, fault: Fault) -> None:
        """To every sink, without characters that a sink might not write."""
        fault = replace(fault, text=printable(fault.text))
        for sink in self._sinks:
            try:
                sink.fault(fault)
            except raised() as error:  # a sink that cannot take note of a fault keeps no other from it
                _log.debug("%s: %s", sink.name, error)

    def ending(self, error: EdgemapError) -> None:
        """Report the failure that ends the run to every sink, but for those whose reader gets it from the caller."""
        kind = FaultKind.LOST if isinstance(error, CameraLostError) else FaultKind.ENDED
        fault = error.fault if isinstance(error, CameraFault) else Fault(kind, str(error))
        for sink in self._sinks:
            if not getattr(sink, "for_caller", False):
                SinkGroup([sink]).fault(fault)

    def close(self) -> None:
        """Close every sink, in order, each failure reported to all; then raise the first one."""
        failure: BaseException | None = None
        for sink in self._sinks:
            try:
                sink.close()
            except raised() as error:  # raised again below
                self.fault(Fault(FaultKind.OUTPUT, f"{sink.name}: {_line(error)}"))
                failure = failure or error
        if failure is not None:
            raise failure


def _line(error: BaseException) -> str:
    """The text of its fault; the traceback of an unknown failure goes to the log."""
    if isinstance(error, EdgemapError):
        return str(error)
    _log.error("a sink failed", exc_info=error)
    return error_line(error)
