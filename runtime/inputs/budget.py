"""Doing less where processor time asks for it: decided outside of the step, recorded, and replayed."""

import time
from collections.abc import Callable
from dataclasses import dataclass

WINDOW_S = 2.0  # over which processor time is counted before a decision
TOO_MUCH = 1.05  # of the share allowed: a window may hold one searched frame more than its part
ROOM = 0.9  # of the share allowed, that doing more may be expected to take
PATIENCE = 3  # windows in a row that have room, before more is done
FORGET = 0.9  # of what a frame took, at each new one


@dataclass(frozen=True, slots=True)
class Effort:
    """Processing effort from a frame on: every `take_every`-th frame is processed by the odometry, and the detector
    runs on every `search_every`-th of those. since: the camera's frame index.
    """

    since: int = 0
    search_every: int = 1
    take_every: int = 1

    @property
    def full(self) -> bool:
        """Whether every frame is taken and searched."""
        return (self.search_every, self.take_every) == (1, 1)

    def takes(self, index: int) -> bool:
        """Whether the camera's frame is taken."""
        return (index - self.since) % self.take_every == 0

    def searches(self, index: int) -> bool:
        """Whether a frame that is taken is searched."""
        return (index - self.since) // self.take_every % self.search_every == 0

    def __str__(self) -> str:
        taken = "every frame" if self.take_every == 1 else f"1 of {self.take_every} frames"
        return f"{taken} taken" + ("" if self.search_every == 1 else f", 1 of {self.search_every} searched")


# The search first: on the demo 1 of 2 or 3 frames searched costs the map next to nothing, while a robot that turns is
# lost to the camera where frames are not taken (benchmarks/README.md).
LADDER = (Effort(0, 1), Effort(0, 2), Effort(0, 3), Effort(0, 5), Effort(0, 2, 2), Effort(0, 2, 3), Effort(0, 2, 4))


class Budget:
    """Chooses the step of `LADDER` from the processor time. share: allowed share of one core. It steps down after one
    window above the share, and up after `PATIENCE` windows in which the next higher step would fit, by the frame times
    so far. clocks: seconds.
    """

    def __init__(
        self,
        share: float,
        clock_s: Callable[[], float] = time.monotonic,
        processor_s: Callable[[], float] = time.process_time,
    ) -> None:
        self._share, self._clock_s, self._processor_s = share, clock_s, processor_s
        self._level, self._roomy, self._spent = 0, 0, False
        self._took_s: dict[bool, float] = {}  # a frame, by whether it is searched
        self._frame: tuple[bool, float] | None = None
        self._window = clock_s(), processor_s()

    def frame(self, searched: bool) -> None:
        """A frame is handed to the step."""
        self._frame = searched, self._processor_s()

    def decide(self) -> tuple[Effort, str] | None:
        """Called before every frame. Returns a new effort with the reason, or None to keep the current one."""
        now_s, used_s = self._clock_s(), self._processor_s()
        self._book(used_s)
        start_s, start_used_s = self._window
        if now_s - start_s < WINDOW_S:
            return None
        self._window = now_s, used_s
        share = (used_s - start_used_s) / (now_s - start_s)
        why = f"{100 * share:.0f} % of a core, {100 * self._share:.0f} allowed"
        if share > TOO_MUCH * self._share:
            self._roomy = 0
            return self._to(self._level + 1, why)
        room = share * self._next_takes() < ROOM * self._share
        self._roomy = self._roomy + 1 if room and self._level > 0 else 0
        if self._roomy < PATIENCE:
            return None
        self._roomy = 0
        return self._to(self._level - 1, why)

    def _book(self, used_s: float) -> None:
        """What the last frame took."""
        if self._frame is not None:
            (searched, before_s), self._frame = self._frame, None
            took_s = self._took_s.get(searched, used_s - before_s)
            self._took_s[searched] = FORGET * took_s + (1.0 - FORGET) * (used_s - before_s)

    def _to(self, level: int, why: str) -> tuple[Effort, str] | None:
        if level < len(LADDER):
            self._level, self._spent = level, False
            return LADDER[level], why
        if self._spent:
            return None
        self._spent = True
        return LADDER[-1], f"{why}, and less than this cannot be done"

    def _next_takes(self) -> float:
        """Processor time one step up over that of now, by what frames took so far."""
        return self._cost(LADDER[max(self._level - 1, 0)]) / max(self._cost(LADDER[self._level]), 1e-9)

    def _cost(self, effort: Effort) -> float:
        """Processor time of one of the camera's frames, on average, s."""
        whole = self._took_s.get(True, 0.0)
        plain = self._took_s.get(False, whole)
        return (plain + (whole - plain) / effort.search_every) / effort.take_every
