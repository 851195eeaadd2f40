"""Wall time of a stream's stamps, as far as the host's clock is right."""

import ctypes
import sys
import time
from bisect import bisect_right
from datetime import UTC, datetime
from functools import cache
from pathlib import Path
from typing import NamedTuple

EARLIEST_S = datetime(2026, 1, 1, tzinfo=UTC).timestamp()  # a host's clock before this program was written is not set
STEP_S = 2.0  # between clocks: less is the delivery of a picture, or drift that is taken over at this size
# Where systems without a battery-backed clock keep the time of their last shutdown, from which they boot.
RESTORED = Path("/var/lib/systemd/timesync/clock"), Path("/etc/fake-hwclock.data")


class ClockReading(NamedTuple):
    """One instant by two clocks. elapsed_s: of a clock that nobody sets and that runs on in suspend. utc_s: seconds
    since 1970; None where the host's clock was not set since it booted."""

    elapsed_s: float
    utc_s: float | None


def host_clock() -> ClockReading:
    """The host's clocks now."""
    boot = getattr(time, "CLOCK_BOOTTIME", None)
    elapsed_s = time.monotonic() if boot is None else time.clock_gettime(boot)
    now_s = time.time()
    return ClockReading(elapsed_s, now_s if now_s > EARLIEST_S and _is_set() else None)


def _is_set() -> bool:
    """Whether a time server or a battery-backed clock has set the host's clock. A host that boots with the time of its
    last shutdown does not know how long it was off."""
    if not sys.platform.startswith("linux"):
        return True
    state = ctypes.CDLL(None).adjtimex(ctypes.create_string_buffer(512))
    unsynchronised = state == 5  # TIME_ERROR of adjtimex(2)
    return not unsynchronised or _has_hardware_clock() or not any(path.exists() for path in RESTORED)


@cache
def _has_hardware_clock() -> bool:
    return any(path.read_text().strip() == "1" for path in Path("/sys/class/rtc").glob("rtc*/hctosys"))


def stream_clock(live: bool, stamp_s: float) -> ClockReading:
    """The clocks at a picture's stamp: a live camera's picture is of now; a file's stamps are seconds since 1970, or
    their wall time is unknown."""
    if live:
        return host_clock()
    since_1970 = 1e9 < stamp_s < 1e10  # as time since a start it would be 31 years or more
    return ClockReading(stamp_s, stamp_s if since_1970 else None)


class WallClock:
    """Wall time of the stamps of one stream. When the host's clock is set, all stamps of the stream take the new time;
    when the stream's clock jumps, as in suspend, only those after it do."""

    def __init__(self) -> None:
        self._starts_s, self._offsets_s = list[float](), list[float]()  # from each stamp on, elapsed time minus stamp
        self._utc_s: float | None = None  # UTC minus elapsed time

    def note(self, stamp_s: float, now: ClockReading) -> None:
        """Takes one picture's stamp with the clocks at that time."""
        offset_s = now.elapsed_s - stamp_s
        if not self._offsets_s or abs(offset_s - self._offsets_s[-1]) > STEP_S:
            self._starts_s.append(stamp_s)
            self._offsets_s.append(offset_s)
        if now.utc_s is not None:
            utc_s = now.utc_s - now.elapsed_s
            self._utc_s = utc_s if self._utc_s is None or abs(utc_s - self._utc_s) > STEP_S else self._utc_s

    def utc(self, stamp_s: float) -> float | None:
        """Seconds since 1970 of a stamp, to the second; None where unknown."""
        if self._utc_s is None:
            return None
        piece = max(bisect_right(self._starts_s, stamp_s) - 1, 0)
        return float(round(stamp_s + self._offsets_s[piece] + self._utc_s))


def utc_text(utc_s: float | None) -> str | None:
    """A wall time as files have it: UTC by ISO 8601."""
    return None if utc_s is None else datetime.fromtimestamp(utc_s, UTC).strftime("%Y-%m-%dT%H:%M:%SZ")
