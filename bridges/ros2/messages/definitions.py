"""ROS 2 message definitions (definitions.txt), the one place that encodes and decodes CDR by them, and their stamps."""

import math
import re
import struct
import time
from collections.abc import Callable
from decimal import Decimal
from functools import cache
from pathlib import Path
from typing import Any

from edgemap.runtime.frames.errors import BridgeError

Message = dict[str, Any]  # a message by field name; fields that are left out are zero

_TEXT = Path(__file__).with_name("definitions.txt").read_text()
_KINDS = re.findall(r"^MSG: (\S+) ?(\S*)\n(.*?)\s*(?=^MSG|\Z)", _TEXT, re.MULTILINE | re.DOTALL)
FIELDS = {kind: fields for kind, _, fields in _KINDS}
HASHES = {kind: type_hash for kind, type_hash, _ in _KINDS if type_hash}  # RIHS01
# What a decoder raises at damaged bytes. MemoryError: a length that no file has.
DAMAGE = (struct.error, ValueError, LookupError, RuntimeError, OverflowError, MemoryError, EOFError)


def definition(kind: str) -> str:
    """A type's own fields, then those of every type it needs, as MCAP's `ros2msg` encoding wants them.

    kind: as in ROS 2, `sensor_msgs/msg/CameraInfo`.
    """
    name = kind.replace("/msg/", "/")
    needed = [name]
    for known in needed:  # grows while it is walked
        for used in re.findall(r"^(\w+/\w+)", FIELDS[known], re.MULTILINE):
            if used not in needed:
                needed.append(used)
    parts = [FIELDS[name] + "\n"]
    parts += [f"{'=' * 80}\nMSG: {used}\n{FIELDS[used]}\n" for used in needed[1:]]
    return "".join(parts)


@cache
def encoder(kind: str) -> Callable[[Message], bytes]:
    """Encodes messages of a kind (`sensor_msgs/msg/CameraInfo`) as little-endian CDR, encapsulation header first.

    Fields that a message leaves out are zero; arrays of int8 are given as bytes. Needs the extra `record`.
    """
    from mcap_ros2._dynamic import serialize_dynamic

    as_bytes = re.sub(r"\bint8\[\]", "uint8[]", definition(kind))  # the same in CDR
    return serialize_dynamic(kind, as_bytes)[kind]


@cache
def decoder(kind: str) -> Callable[[bytes], Any]:
    """Decodes CDR bytes of a kind to an object with the fields as attributes.

    Raises `DAMAGE` at damaged bytes.
    """
    from mcap_ros2._dynamic import generate_dynamic

    return generate_dynamic(kind, definition(kind))[kind]


NEAR_S = 5.0  # of a clock, for a stamp to be of that clock
CLOCK_SET_S = 0.1  # change of the wall clock against the monotonic one, from which on somebody has set it


def to_ns(stamp_s: float) -> int:
    """The nearest nanosecond. Raises BridgeError for a stamp that a ROS 2 header cannot hold.

    `to_s` gives the very same float again for every stamp that is a whole number of nanoseconds, and for every one
    beyond 2^23 s, where floats are coarser than that.
    """
    if not 0.0 <= stamp_s < 2**31:  # builtin_interfaces/Time counts in int32
        raise BridgeError(f"stamp {stamp_s} s cannot be recorded: ROS 2 counts from 0 to {2**31} s")
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


class RosClock:
    """ROS time of a stream's stamps: an offset, taken from the first frame, that follows the wall clock when that is
    set (NTP after a boot without a clock)."""

    def __init__(self, stated_s: Callable[[], float] | None = None) -> None:
        """stated_s: the offset from the stream to ROS time, where it is known."""
        self._stated_s, self._offset_s, self._wall_s = stated_s, 0.0, math.nan

    def offset_s(self, stamp_s: float, age_s: float = 0.0) -> float:
        """The offset now. stamp_s: of a frame that arrived `age_s` ago."""
        if self._stated_s is not None:
            return self._stated_s()
        wall_s, monotonic_s = time.time() - age_s, time.monotonic() - age_s
        set_s = wall_s - monotonic_s - self._wall_s
        if math.isnan(set_s):
            self._offset_s = ros_offset_s(stamp_s, wall_s, monotonic_s)
        elif abs(set_s) > CLOCK_SET_S:
            self._offset_s += set_s
        else:
            return self._offset_s
        self._wall_s = wall_s - monotonic_s
        return self._offset_s


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
