"""Stage times of a step, and what is done every so many seconds of stream."""

import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from time import perf_counter, thread_time
from typing import ClassVar

import numpy as np


class Stopwatch:
    """Stage times of one step: `start`, then a block `with stage(name):` each. stages_ms: milliseconds by stage, in
    order.

    processor_time: whether all stopwatches count that of their thread, which no other program can add to, as `bench`
    has them.
    """

    processor_time: ClassVar[bool] = False

    def __init__(self) -> None:
        self.stages_ms: dict[str, float] = {}

    def start(self) -> None:
        """Starts a new step."""
        self.stages_ms = {}

    @contextmanager
    def stage(self, stage: str) -> Iterator[None]:
        """Adds the time of the block to a stage."""
        began_s = _now_s()
        yield
        self.stages_ms[stage] = self.stages_ms.get(stage, 0.0) + (_now_s() - began_s) * 1e3


def _now_s() -> float:
    return thread_time() if Stopwatch.processor_time else perf_counter()


def percentiles(values_ms: Sequence[float]) -> dict[str, float]:
    """p50, p95 and p99 of stage times, ms, rounded to a microsecond; empty for none."""
    quantiles = (50, 95, 99)
    values = np.percentile(np.asarray(values_ms), quantiles).tolist() if len(values_ms) else []
    return {f"p{q}": round(value, 3) for q, value in zip(quantiles, values, strict=False)}


class StreamTimer:
    """When something is due again by the stream's stamps: at first, after `every_s`, and where stamps went back."""

    def __init__(self, every_s: float) -> None:
        self._every_s, self._done_s = every_s, -math.inf

    def is_due(self, stamp_s: float) -> bool:
        """Whether it is due."""
        return not 0.0 <= stamp_s - self._done_s < self._every_s

    def done(self, stamp_s: float = -math.inf) -> None:
        """It was done at this stamp; without one it is due at once."""
        self._done_s = stamp_s

    def due(self, stamp_s: float) -> bool:
        """Whether it is due; if so, it counts as done."""
        due = self.is_due(stamp_s)
        self._done_s = stamp_s if due else self._done_s
        return due
