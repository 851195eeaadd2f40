"""Scores of a map: its objects, matched one to one with the true ones; each found, misplaced, missed or extra."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from edgemap.evaluation.rows import STATES, EvaluationRow, State
from edgemap.geometry.map_object import CHI2_95, MapObject

FOUND_M = 0.5  # from its true one, an object is found
MINIMUM_FRAMES = 10  # seen in fewer, a true object is neither hit nor miss
CONFIDENCE_BINS = (0.0, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0)
MISPLACED_M = 1.5  # farther from any true one, it is extra, and not used to judge covariances


@dataclass(frozen=True, slots=True)
class TrueObject:
    """A true object. x_m, y_m: centre of the footprint, start-pose frame. frames: number of frames in which it is
    visible.

    footprint_m: its corners, same frame; empty where unknown.
    """

    label: str
    x_m: float
    y_m: float
    on_floor: bool
    frames: int
    footprint_m: tuple[tuple[float, float], ...] = ()


Pair = tuple[MapObject, TrueObject]


def scored(truth: Sequence[TrueObject]) -> list[TrueObject]:
    """The objects that a map must contain: on the floor, and visible often enough."""
    return [item for item in truth if item.on_floor and item.frames >= MINIMUM_FRAMES]


def score_map(objects: Sequence[MapObject], truth: Sequence[TrueObject]) -> dict[str, Any]:
    """Match by class, one to one, within 0.5 m, no alignment; most pairs first, then smallest distance.

    True objects visible in fewer frames are ignored: neither hit nor miss. A mapped object that is not on the floor is
    a false positive. Gives precision, recall, f1, median_error_m, p90_error_m, covered95 (share of true positions
    inside the 95 % ellipse), counts, and the same per class; figures without data are null. anees (normalised: 1 is
    consistent) and ellipse_m2 (mean area of the 95 % ellipse) are over all mapped objects with a true one of their
    class on the floor within 1.5 m, the nearest, matched or not and however seldom seen. reliability: of `reliability`.
    """
    labels = sorted({item.label for item in objects} | {item.label for item in truth})
    matches = {label: _match(label, objects, truth) for label in labels}
    figures = _figures(list(matches.values()))
    outcomes = [(item.confidence, True) for match in matches.values() for item, _ in match.found]
    outcomes += [(item.confidence, False) for match in matches.values() for item in match.left]
    figures["reliability"] = reliability(outcomes)
    counted = {label: match for label, match in matches.items() if match.found or match.left or match.missed}
    figures["per_class"] = {label: _figures([match]) for label, match in counted.items()}
    return figures


def reliability(outcomes: Sequence[tuple[float, bool]]) -> dict[str, Any]:
    """Calibration of confidences, from (confidence, whether it was matched) of mapped objects.

    Gives `bins`, those with any objects: from and to, how many there are, how many of them are real, and their mean
    confidence; and `ece`, the expected calibration error (Guo et al. 2017), null without objects.
    """
    confidences, real = np.array(outcomes, dtype=np.float64).reshape(-1, 2).T
    places = np.clip(np.searchsorted(CONFIDENCE_BINS, confidences, side="right") - 1, 0, len(CONFIDENCE_BINS) - 2)
    bins = [
        {
            "from": CONFIDENCE_BINS[place],
            "to": CONFIDENCE_BINS[place + 1],
            "objects": int((places == place).sum()),
            "real": int(real[places == place].sum()),
            "mean_confidence": round(float(confidences[places == place].mean()), 4),
        }
        for place in sorted(set(places.tolist()))
    ]
    error = sum(abs(one["real"] - one["objects"] * one["mean_confidence"]) for one in bins)
    return {"ece": round(error / len(outcomes), 4) if outcomes else None, "bins": bins}


@dataclass(frozen=True, slots=True)
class _Match:
    """One class, sorted out: pairs found; pairs with true objects seen too seldom; what is left of both; every mapped
    object near a true one, with the nearest."""

    found: list[Pair]
    unscored: list[Pair]
    left: list[MapObject]
    missed: list[TrueObject]
    near: list[Pair]


def _match(label: str, objects: Sequence[MapObject], truth: Sequence[TrueObject]) -> _Match:
    mapped = [item for item in objects if item.label == label]
    standing = [item for item in truth if item.label == label and item.on_floor]
    found, left, missed = _take(mapped, scored(standing), FOUND_M)
    unscored, left, _ = _take(left, [item for item in standing if item.frames < MINIMUM_FRAMES], FOUND_M)
    near = [(item, real) for item in mapped if (real := _nearest(item, standing)) is not None]
    return _Match(found, unscored, left, missed, near)


def _take(
    mapped: list[MapObject], true: list[TrueObject], radius_m: float
) -> tuple[list[Pair], list[MapObject], list[TrueObject]]:
    """The pairs within the radius, and what is left of both."""
    pairs = pairs_within(mapped, true, radius_m)
    rows, columns = {row for row, _ in pairs}, {column for _, column in pairs}
    left = [item for row, item in enumerate(mapped) if row not in rows]
    return (
        [(mapped[row], true[column]) for row, column in pairs],
        left,
        [item for column, item in enumerate(true) if column not in columns],
    )


def _offset_m(item: MapObject, real: TrueObject) -> NDArray[np.float64]:
    return item.position_m - [real.x_m, real.y_m]


def _mahalanobis2(item: MapObject, real: TrueObject) -> float:
    offset = _offset_m(item, real)
    return float(offset @ np.linalg.solve(item.covariance_m2, offset))


def _nearest(item: MapObject, standing: list[TrueObject]) -> TrueObject | None:
    """The nearest true object, None where all are farther than 1.5 m."""
    nearest = min(standing, key=lambda real: np.linalg.norm(_offset_m(item, real)), default=None)
    return nearest if nearest and np.linalg.norm(_offset_m(item, nearest)) <= MISPLACED_M else None


def pairs_within(mapped: list[MapObject], true: list[TrueObject], radius_m: float) -> list[tuple[int, int]]:
    """Indices (mapped, true) of the one-to-one pairs within a radius: most pairs first, then smallest distance."""
    if not mapped or not true:
        return []
    places = np.array([[item.x_m, item.y_m] for item in true])
    distance = np.array([np.linalg.norm(places - item.position_m, axis=1) for item in mapped])
    cost = np.where(distance <= radius_m, distance, 1e3)
    rows, columns = linear_sum_assignment(cost)
    return [(int(r), int(c)) for r, c in zip(rows, columns, strict=True) if distance[r, c] <= radius_m]


def _figures(matches: list[_Match]) -> dict[str, Any]:
    found = [pair for match in matches for pair in match.found]
    near = [pair for match in matches for pair in match.near]
    errors = [float(np.linalg.norm(_offset_m(*pair))) for pair in found]
    covered = [_mahalanobis2(*pair) <= CHI2_95 for pair in found]
    nees = [_mahalanobis2(*pair) / 2.0 for pair in near]
    ellipses = [np.pi * CHI2_95 * float(np.sqrt(np.linalg.det(item.covariance_m2))) for item, _ in near]
    mapped = len(found) + sum(len(match.left) for match in matches)
    true = len(found) + sum(len(match.missed) for match in matches)
    return {
        "precision": share(len(errors), mapped),
        "recall": share(len(errors), true),
        "f1": share(2 * len(errors), mapped + true),
        "median_error_m": round(float(np.median(errors)), 4) if errors else None,
        "p90_error_m": round(float(np.percentile(errors, 90)), 4) if errors else None,
        "covered95": share(sum(covered), len(covered)),
        "anees": round(float(np.mean(nees)), 4) if nees else None,
        "ellipse_m2": round(float(np.mean(ellipses)), 4) if ellipses else None,
        "objects_mapped": mapped,
        "objects_true": true,
        "objects_found": len(errors),
    }


def share(part: int, whole: int) -> float | None:
    """A part of a whole as figures have it; None of nothing."""
    return round(part / whole, 4) if whole else None


def evaluation_rows(objects: Sequence[MapObject], truth: Sequence[TrueObject]) -> list[EvaluationRow]:
    """A row for each mapped object and for each true one that counts; ordered by state, then label.

    By class, one to one: within 0.5 m is found; of what is left, within 1.5 m is misplaced. True objects visible in
    fewer than 10 frames are not scored, and a mapped object within 0.5 m of one does not count as extra.
    """
    rows: list[EvaluationRow] = []
    for label in sorted({item.label for item in objects} | {item.label for item in truth}):
        match = _match(label, objects, truth)
        misplaced, extra, missed = _take(match.left, match.missed, MISPLACED_M)
        pairs: dict[State, list[Pair]] = {"found": match.found, "unscored": match.unscored, "misplaced": misplaced}
        rows += [_row(state, *pair) for state, found in pairs.items() for pair in found]
        rows += [
            EvaluationRow("missed", label, None, (item.x_m, item.y_m), footprint_m=item.footprint_m) for item in missed
        ]
        rows += [EvaluationRow("extra", label, item.id) for item in extra]
    return sorted(rows, key=lambda row: (STATES.index(row.state), row.label))


def _row(state: State, item: MapObject, real: TrueObject) -> EvaluationRow:
    error_m, covered = float(np.linalg.norm(_offset_m(item, real))), _mahalanobis2(item, real) <= CHI2_95
    return EvaluationRow(state, item.label, item.id, (real.x_m, real.y_m), error_m, covered, real.footprint_m)
