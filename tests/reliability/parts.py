"""What a part of `make reliability` is: a module with `run`, callable alone, bounded and seeded."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

# Module name to one line. Each module has a function `run`, a `ReliabilityPart`.
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


class ReliabilityPart(Protocol):
    """One part. share: of its full size, 1 for the issue's numbers, less for a quick look. out: its own folder."""

    def __call__(self, seed: int, share: float, out: Path) -> PartReport:
        """Run the part; a missed target is in the report, never an exception."""
        ...
