"""Seconds to nanoseconds and back without losing a bit."""

from decimal import Decimal
from typing import Any

from edgemap.runtime.frames.errors import RecordingError

LAST_SECOND = 2**31  # builtin_interfaces/Time counts in int32
NEAR_S = 5.0  # of a clock, for a stamp to be of that clock


def to_ns(stamp_s: float) -> int:
    """The nearest nanosecond. Raises RecordingError for a stamp that a ROS 2 header cannot hold.

    `to_s` gives the very same float again for every stamp that is a whole number of nanoseconds, and for every one
    beyond 2^23 s, where floats are coarser than that.
    """
    if not 0.0 <= stamp_s < LAST_SECOND:
        raise RecordingError(f"stamp {stamp_s} s cannot be recorded: ROS 2 counts from 0 to {LAST_SECOND} s")
    return round(Decimal(stamp_s) * 1_000_000_000)


def to_s(stamp_ns: int) -> float:
    """Seconds, correctly rounded."""
    return stamp_ns / 1_000_000_000  # of two integers, which Python divides exactly before it rounds


def ros_time(stamp_ns: int) -> dict[str, int]:
    """`builtin_interfaces/Time`."""
    return {"sec": stamp_ns // 1_000_000_000, "nanosec": stamp_ns % 1_000_000_000}


def ns_of(time: Any) -> int:
    """Nanoseconds of a decoded `builtin_interfaces/Time`."""
    return int(time.sec) * 1_000_000_000 + int(time.nanosec)


def ros_offset_s(stamp_s: float, wall_s: float, monotonic_s: float) -> float:
    """Offset to add to a stream's stamps, from one frame that has just arrived.

    Cameras stamp by the wall clock or by the monotonic one; what is near neither (a file, a device's own clock)
    counts as taken now.
    """
    if abs(stamp_s - wall_s) < NEAR_S:
        return 0.0
    if abs(stamp_s - monotonic_s) < NEAR_S:
        return wall_s - monotonic_s
    return wall_s - stamp_s
