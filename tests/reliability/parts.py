"""What a part of `make reliability` is: a module with `run`, callable alone, bounded and seeded."""

from dataclasses import dataclass, field
from typing import Any

# Module name to one line. Each module has `run(seed, share, out)`: share of its full size, 1 for the published figures;
# out: a folder of its own. A missed target is in the report, never an exception.
PARTS: dict[str, str] = {
    "kills": "kill -9 in the middle of a run",
    "day": "a day of driving, compressed",
    "hour": "an hour of driving through a rendered home",
    "lies": "poses, wheels, depth and IMU that lie, on three homes: named, and no wrong map is good",
    "honest": "honest poses, wheels, depth and IMU on 30 homes and real walks: nobody is accused",
    "readers": "damaged and hostile files: every reader on mutated files",
    "fuzz": "random camera faults, clocks, two clocks, headings and maps through the whole of a run",
}


@dataclass(frozen=True, slots=True)
class PartReport:
    """Result of a part. failures: one line for each target that is missed. figures: JSON. table: lines to print."""

    failures: tuple[str, ...]
    figures: dict[str, Any] = field(default_factory=dict)
    table: tuple[str, ...] = ()
