"""Stage times of a step."""

from collections.abc import Sequence
from time import perf_counter, thread_time
from typing import ClassVar

import numpy as np


class Stopwatch:
    """Stage times of one step: `start`, then `stage(name)` after each. stages_ms: milliseconds by stage, in order.

    processor_time: whether all stopwatches count that of their thread, which no other program can add to, as `bench`
    has them.
    """

    processor_time: ClassVar[bool] = False

    def __init__(self) -> None:
        self.stages_ms: dict[str, float] = {}
        self._last = _now_s()

    def start(self) -> None:
        """Starts a new step."""
        self.stages_ms = {}
        self._last = _now_s()

    def stage(self, stage: str) -> None:
        """Adds the time since the last call to a stage."""
        now = _now_s()
        self.stages_ms[stage] = self.stages_ms.get(stage, 0.0) + (now - self._last) * 1e3
        self._last = now


def _now_s() -> float:
    return thread_time() if Stopwatch.processor_time else perf_counter()


def percentiles(values_ms: Sequence[float]) -> dict[str, float]:
    """p50, p95 and p99 of stage times, ms, rounded to a microsecond; empty for none."""
    quantiles = (50, 95, 99)
    found = np.percentile(np.asarray(values_ms), quantiles).tolist() if len(values_ms) else []
    return {f"p{q}": round(value, 3) for q, value in zip(quantiles, found, strict=False)}
