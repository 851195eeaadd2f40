"""Where the time of a step goes."""

from __future__ import annotations

from time import perf_counter


class Stopwatch:
    """Laps of one step: `start`, then `lap(name)` after each stage. laps_ms: milliseconds by stage, in order."""

    def __init__(self) -> None:
        self.laps_ms: dict[str, float] = {}
        self._last = perf_counter()

    def start(self) -> None:
        """Forget the last step and begin."""
        self.laps_ms = {}
        self._last = perf_counter()

    def lap(self, stage: str) -> None:
        """Book the time since the last lap on a stage."""
        now = perf_counter()
        self.laps_ms[stage] = (now - self._last) * 1e3
        self._last = now
