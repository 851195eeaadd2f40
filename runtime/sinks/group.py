"""The rule for sinks that fail, in one place: the run goes on, and failure and recovery are reported."""

import logging
from collections.abc import Sequence
from dataclasses import dataclass

from edgemap.geometry.errors import EdgemapError
from edgemap.geometry.objects.map_object import MapObject
from edgemap.runtime.reading import error_line
from edgemap.runtime.sinks.protocol import Sink
from edgemap.runtime.slam import StepResult

_log = logging.getLogger(__name__)


@dataclass(slots=True)
class _Outage:
    since_s: float
    steps: int = 1


class SinkGroup:
    """All sinks of a run as one that never fails before `close`. See `Sink` for what a sink may rely on."""

    name = "sinks"

    def __init__(self, sinks: Sequence[Sink]) -> None:
        self._sinks = sinks
        self._outages: dict[int, _Outage] = {}  # by the sink's place

    def write(self, result: StepResult, objects: list[MapObject]) -> None:
        """Offer a step's result to every sink."""
        stamp_s = result.frame.stamp_s
        for place, sink in enumerate(self._sinks):
            outage = self._outages.get(place)
            try:
                sink.write(result, objects)
            except Exception as error:  # sinks raise what they like; mapping goes on
                if outage is not None:
                    outage.steps += 1
                    continue
                self._outages[place] = _Outage(stamp_s)
                self.fault(f"{sink.name}: {_line(error)}; the run goes on")
                continue
            if outage is not None:
                del self._outages[place]
                away_s = stamp_s - outage.since_s
                self.fault(f"{sink.name}: works again after {away_s:.1f} s of stream ({outage.steps} steps failed)")

    def fault(self, text: str) -> None:
        """Tell every sink."""
        for sink in self._sinks:
            try:
                sink.fault(text)
            except Exception as error:  # a sink that cannot take note of a fault keeps no other from it
                _log.debug("%s: %s", sink.name, error)

    def close(self) -> None:
        """Close every sink, in order, each failure reported to all; then raise the first one."""
        failure: Exception | None = None
        for sink in self._sinks:
            try:
                sink.close()
            except Exception as error:  # raised again below
                self.fault(f"{sink.name}: {_line(error)}")
                failure = failure or error
        if failure is not None:
            raise failure


def _line(error: Exception) -> str:
    """What a fault says of it; the traceback of an unknown failure goes to the log."""
    if isinstance(error, EdgemapError):
        return " ".join(str(error).split())
    _log.error("a sink failed", exc_info=error)
    return error_line(error)
