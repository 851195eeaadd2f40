"""Doing less where processor time or temperature asks for it: decided outside of the step, recorded, and replayed."""

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

WINDOW_S = 2.0  # over which processor time is counted before a decision
SLOW_S = 10.0  # between two decisions by temperature, which follows slowly
TOO_MUCH = 1.05  # of the share allowed: a window may hold one searched frame more than its part
ROOM = 0.9  # of the share allowed, that doing more may be expected to take
PATIENCE = 3  # windows in a row that have room, before more is done
COOLER_C = 5.0  # below the limit, before more is done
FORGET = 0.9  # of what a frame took, at each new one
THERMAL = Path("/sys/class/thermal")


@dataclass(frozen=True, slots=True)
class Effort:
    """What is done from a frame on: every `take_every`-th frame of the camera is taken, all of which give the odometry
    its motion, and every `search_every`-th of those is searched for objects. since: the camera's frame index."""

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


def hottest_c(folder: Path = THERMAL) -> float | None:
    """The hottest thermal zone of this machine, degrees Celsius; None where it has none."""
    found = []
    for path in folder.glob("thermal_zone*/temp"):
        try:
            found.append(float(path.read_text()) / 1000.0)
        except (OSError, ValueError):  # zones that are switched off
            continue
    return max(found, default=None)


class Budget:
    """Decides, from processor time (of one core) and temperature, how far down `LADDER` a run goes.

    share, limit_c: None for no limit. One step down after a window above a limit; one step up after `PATIENCE` windows
    in which what the next higher step would take, by what frames took so far, leaves room. clocks: seconds.
    """

    def __init__(
        self,
        share: float | None,
        limit_c: float | None = None,
        clock_s: Callable[[], float] = time.monotonic,
        processor_s: Callable[[], float] = time.process_time,
        temperature_c: Callable[[], float | None] = hottest_c,
    ) -> None:
        self._share, self._limit_c = math.inf if share is None else share, limit_c
        self._clock_s, self._processor_s, self._temperature_c = clock_s, processor_s, temperature_c
        self._level, self._roomy, self._spent = 0, 0, False
        self._took_s: dict[bool, float] = {}  # a frame, by whether it is searched
        self._frame: tuple[bool, float] | None = None
        self._window = clock_s(), processor_s()
        self._cooled_s = self._window[0]

    def frame(self, searched: bool) -> None:
        """A frame is handed to the step."""
        self._frame = searched, self._processor_s()

    def decide(self) -> tuple[Effort, str] | None:
        """Called before every frame: another effort, and why; None to go on."""
        now_s, used_s = self._clock_s(), self._processor_s()
        self._book(used_s)
        start_s, start_used_s = self._window
        if now_s - start_s < WINDOW_S:
            return None
        self._window = now_s, used_s
        share, heat_c = (used_s - start_used_s) / (now_s - start_s), self._heat_c()
        hot = heat_c > 0.0
        if share > TOO_MUCH * self._share or (hot and now_s - self._cooled_s >= SLOW_S):
            self._roomy, self._cooled_s = 0, now_s
            return self._to(self._level + 1, self._why(share, heat_c))
        room = heat_c < -COOLER_C and share * self._next_takes() < ROOM * self._share
        self._roomy = self._roomy + 1 if room and self._level > 0 else 0
        if self._roomy < PATIENCE:
            return None
        self._roomy = 0
        return self._to(self._level - 1, self._why(share, heat_c))

    def _book(self, used_s: float) -> None:
        """What the last frame took."""
        if self._frame is not None:
            (searched, before_s), self._frame = self._frame, None
            took_s = self._took_s.get(searched, used_s - before_s)
            self._took_s[searched] = FORGET * took_s + (1.0 - FORGET) * (used_s - before_s)

    def _heat_c(self) -> float:
        """Above the limit; minus infinity where there is none."""
        found = None if self._limit_c is None else self._temperature_c()
        return -math.inf if found is None or self._limit_c is None else found - self._limit_c

    def _why(self, share: float, heat_c: float) -> str:
        reasons = [f"{100 * share:.0f} % of a core, {100 * self._share:.0f} allowed"] if self._share < math.inf else []
        if self._limit_c is not None and heat_c > -math.inf:
            reasons.append(f"{self._limit_c + heat_c:.0f} C, {self._limit_c:.0f} allowed")
        return ", ".join(reasons)

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
