"""Evaluation rows of a map: each object is found, misplaced, missed or extra, by the same rule as `score_map`."""

from collections.abc import Sequence

import numpy as np

from edgemap.evaluation.objects import FOUND_M, MINIMUM_FRAMES, TrueObject, pairs_within, scored
from edgemap.geometry.map_object import CHI2_95, MapObject
from edgemap.geometry.objects.evaluation_row import STATES, EvaluationRow, State

MISPLACED_M = 1.5


def evaluation_rows(objects: Sequence[MapObject], truth: Sequence[TrueObject]) -> list[EvaluationRow]:
    """A row for each mapped object and for each true one that counts; ordered by state, then label.

    By class, one to one: within 0.5 m is found; of what is left, within 1.5 m is misplaced. True objects visible in
    fewer than 10 frames are not scored, and a mapped object within 0.5 m of one does not count as extra.
    """
    rows: list[EvaluationRow] = []
    for label in sorted({item.label for item in objects} | {item.label for item in truth}):
        mapped = [item for item in objects if item.label == label]
        standing = [item for item in truth if item.label == label and item.on_floor]
        wanted = scored(standing)
        seldom = [item for item in standing if item.frames < MINIMUM_FRAMES]
        mapped, wanted = _take(rows, "found", mapped, wanted, FOUND_M)
        mapped, _ = _take(rows, "unscored", mapped, seldom, FOUND_M)
        mapped, wanted = _take(rows, "misplaced", mapped, wanted, MISPLACED_M)
        rows += [EvaluationRow("missed", label, None, _place(item), footprint_m=item.footprint_m) for item in wanted]
        rows += [EvaluationRow("extra", label, item.id) for item in mapped]
    return sorted(rows, key=lambda row: (STATES.index(row.state), row.label))


def _take(
    rows: list[EvaluationRow], state: State, mapped: list[MapObject], true: list[TrueObject], radius_m: float
) -> tuple[list[MapObject], list[TrueObject]]:
    """Pair what lies within the radius, add the pairs to the rows; what is left of both."""
    pairs = pairs_within(mapped, true, radius_m)
    for row, column in pairs:
        item, real = mapped[row], true[column]
        off = item.position_m - _place(real)
        covered = bool(off @ np.linalg.solve(item.covariance_m2, off) <= CHI2_95)
        error_m = float(np.linalg.norm(off))
        rows.append(EvaluationRow(state, item.label, item.id, _place(real), error_m, covered, real.footprint_m))
    used_rows, used_columns = {row for row, _ in pairs}, {column for _, column in pairs}
    return (
        [item for index, item in enumerate(mapped) if index not in used_rows],
        [item for index, item in enumerate(true) if index not in used_columns],
    )


def _place(item: TrueObject) -> tuple[float, float]:
    return (item.x_m, item.y_m)
