"""When to open a camera again, when to reset it, and when to give up: numbers and a clock, no hardware."""

import statistics
from collections import deque
from dataclasses import dataclass

STALL_INTERVALS, RESET_EVERY = 10, 2
BACK_OFF_LIMIT_S, SETTLE_S = 30.0, 2.0


@dataclass(frozen=True, slots=True)
class RecoveryRule:
    """Timeouts and retries of a live camera's supervisor.

    first_frame_limit_s: silence allowed before the first frame: devices wake slowly. After an opening it is three
    times the stall limit, doubled with each opening in a row, at most this. stall_limit_s: a frame is late after ten
    of the camera's own median frame intervals, at least so many seconds. Every second opening is preceded by a
    hardware reset, where the camera has one. back_off_s: wait before the second opening in a row, doubled each time,
    at most half a minute. A frame ends the row: the next one begins as far on as there were outages without two
    seconds of frames between them. restarts: openings that may be spent; refill_s of frames give one back.
    """

    first_frame_limit_s: float = 10.0
    stall_limit_s: float = 1.0
    back_off_s: float = 0.5
    restarts: int = 20
    refill_s: float = 30.0


class RecoveryClock:
    """Keeps the intervals between frames, the restarts that are left, and when the next one is due."""

    def __init__(self, rule: RecoveryRule, now_s: float) -> None:
        self.rule = rule
        self.restarts = 0  # in a row
        self._outages = 0  # in a row, each ended by a frame
        self.spent = 0.0
        self.heard_s = now_s
        self._intervals_s: deque[float] = deque(maxlen=30)
        self.fresh = True  # no frame since the device was opened
        self._restarted_s = now_s

    @property
    def stall_limit_s(self) -> float:
        """Longest allowed silence of the device, s."""
        if not self._intervals_s:
            return self.rule.first_frame_limit_s
        running = max(self.rule.stall_limit_s, STALL_INTERVALS * statistics.median(self._intervals_s))
        waking = min(self.rule.first_frame_limit_s, 3.0 * running * 2.0 ** max(0, self.restarts - 1))
        return waking if self.fresh else running

    @property
    def exhausted(self) -> bool:
        """Whether the budget is spent."""
        return self.spent > self.rule.restarts - 1

    def frame(self, now_s: float) -> None:
        """A good frame has arrived."""
        if self.fresh and self.restarts:
            self._outages += 1
            self.restarts = self._outages
        if not self.fresh:
            self._intervals_s.append(now_s - self.heard_s)
            self.spent = max(0.0, self.spent - (now_s - self.heard_s) / self.rule.refill_s)
        self.heard_s, self.fresh = now_s, False
        if now_s - self._restarted_s >= SETTLE_S:
            self.restarts = self._outages = 0

    def restart(self, now_s: float) -> bool:
        """Uses one restart. Returns whether it should begin with a hardware reset."""
        self.restarts += 1
        self.spent += 1.0
        self.heard_s = self._restarted_s = now_s
        self.fresh = True
        return self.restarts % RESET_EVERY == 0

    def back_off_s(self) -> float:
        """Wait before the next restart, s; 0 before the first in a row."""
        if self.restarts == 0:
            return 0.0
        return min(BACK_OFF_LIMIT_S, self.rule.back_off_s * 2.0 ** (self.restarts - 1))
