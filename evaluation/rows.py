"""One row of a run's evaluation table: a mapped object, a true one, or a matched pair."""

from dataclasses import dataclass
from typing import Literal

State = Literal["found", "misplaced", "missed", "extra", "unscored"]
STATES: tuple[State, ...] = ("found", "misplaced", "missed", "extra", "unscored")


@dataclass(frozen=True, slots=True)
class EvaluationRow:
    """One true object, one mapped object, or both matched; map frame, metres.

    state: found (near enough), misplaced (right class, but farther off), missed (true, not mapped), extra (mapped, not
    true), unscored (mapped, and true, but visible too rarely to be scored). object_id: the mapped object, None where
    missed. true_m: the true centre, None where extra. error_m: between the two. covered: whether the true centre lies
    inside the mapped 95 % ellipse. footprint_m: corners of the true footprint, empty where unknown.
    """

    state: State
    label: str
    object_id: str | None = None
    true_m: tuple[float, float] | None = None
    error_m: float | None = None
    covered: bool | None = None
    footprint_m: tuple[tuple[float, float], ...] = ()


def tally(evaluation_rows: list[EvaluationRow]) -> str:
    """`9 found, 2 missed, 1 extra`: the count of each state that occurs, in the order of `STATES`."""
    counts = {state: sum(evaluation_row.state == state for evaluation_row in evaluation_rows) for state in STATES}
    return ", ".join(f"{count} {state}" for state, count in counts.items() if count) or "nothing to compare"
