"""Share of frames in which each odometry measured a motion."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

ANSWERS = "used", "blind", "left_out"


def availability(steps: Sequence[Mapping[str, str]]) -> dict[str, dict[str, float]]:
    """Shares of the steps in which each odometry was `used`, `blind` (it measured nothing) or `left_out` (it measured,
    and the others' motion was used), by its name. steps: one of these for each odometry and motion."""
    names = dict.fromkeys(name for step in steps for name in step)
    return {
        name: {answer: _share([step[name] for step in steps if name in step], answer) for answer in ANSWERS}
        for name in names
    }


def _share(given: Sequence[str], answer: str) -> float:
    return round(given.count(answer) / len(given), 4)
