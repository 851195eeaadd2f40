"""Scores of a map: its objects, matched one to one with the true ones; each found, misplaced, missed or extra."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import compress, pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from edgemap.evaluation.rows import STATES, EvaluationRow, State
from edgemap.geometry.arrays import Array
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
    rows, near = evaluation_rows(objects, truth), _near(objects, truth)
    confidence = {item.id: item.confidence for item in objects}
    judged = [row for row in rows if row.state != "unscored"]
    outcomes = [(confidence[row.object_id], row.state == "found") for row in judged if row.object_id is not None]
    per_class = {
        label: _figures([row for row in rows if row.label == label], [pair for pair in near if pair[0].label == label])
        for label in sorted({row.label for row in judged})
    }
    return _figures(rows, near) | {"reliability": reliability(outcomes), "per_class": per_class}


def reliability(outcomes: Sequence[tuple[float, bool]]) -> dict[str, Any]:
    """Calibration of confidences, from (confidence, whether it was matched) of mapped objects.

    Gives `bins`, those with any objects: from and to, how many there are, how many of them are real, and their mean
    confidence; and `ece`, the expected calibration error (Guo et al. 2017), null without objects.
    """
    confidences, real = np.array(outcomes, dtype=np.float64).reshape(-1, 2).T
    places, bins = np.digitize(confidences, CONFIDENCE_BINS[1:-1]), list[dict[str, Any]]()
    for place, (low, high) in enumerate(pairwise(CONFIDENCE_BINS)):
        if (mine := places == place).any():
            row = {"from": low, "to": high, "objects": int(mine.sum()), "real": int(real[mine].sum())}
            bins.append(row | {"mean_confidence": round(float(confidences[mine].mean()), 4)})
    error = sum(abs(one["real"] - one["objects"] * one["mean_confidence"]) for one in bins)
    return {"ece": round(error / len(outcomes), 4) if outcomes else None, "bins": bins}


def evaluation_rows(objects: Sequence[MapObject], truth: Sequence[TrueObject]) -> list[EvaluationRow]:
    """A row for each mapped object and for each true one that counts; ordered by state, then label.

    By class, one to one: within 0.5 m is found; of what is left, within 1.5 m is misplaced. True objects visible in
    fewer than 10 frames are not scored, and a mapped object within 0.5 m of one does not count as extra.
    """
    standing = [item for item in truth if item.on_floor]
    counts = np.array([item.frames >= MINIMUM_FRAMES for item in standing], np.bool_)
    apart_m = distances_m(objects, standing)
    mapped, true = np.ones(len(objects), np.bool_), np.ones(len(standing), np.bool_)  # without a row so far
    asked: dict[State, tuple[NDArray[np.bool_], float]] = {
        "found": (counts, FOUND_M), "unscored": (~counts, FOUND_M), "misplaced": (counts, MISPLACED_M),
    }  # fmt: skip
    rows = list[EvaluationRow]()
    for state, (which, reach_m) in asked.items():
        pairs = pairs_within(np.where(mapped[:, None] & true & which, apart_m, np.inf), reach_m)
        for item, real in ((objects[row], standing[column]) for row, column in zip(*pairs, strict=True)):
            error_m, covered = float(np.linalg.norm(_offset_m(item, real))), _mahalanobis2(item, real) <= CHI2_95
            facts = (real.x_m, real.y_m), error_m, covered, real.footprint_m
            rows.append(EvaluationRow(state, item.label, item.id, *facts))
        mapped[pairs[0]], true[pairs[1]] = False, False
    for real in compress(standing, true & counts):
        rows.append(EvaluationRow("missed", real.label, None, (real.x_m, real.y_m), footprint_m=real.footprint_m))
    rows += [EvaluationRow("extra", item.label, item.id) for item in compress(objects, mapped)]
    return sorted(rows, key=lambda row: (STATES.index(row.state), row.label))


def distances_m(objects: Sequence[MapObject], truth: Sequence[TrueObject]) -> Array:
    """Distances (N, M) of mapped from true objects; infinite where the labels differ."""
    ours = np.array([item.position_m for item in objects]).reshape(-1, 1, 2)
    theirs = np.array([(item.x_m, item.y_m) for item in truth]).reshape(-1, 2)
    same = np.equal.outer(*(np.array([item.label for item in items], np.str_) for items in (objects, truth)))
    return np.where(same, np.linalg.norm(theirs - ours, axis=2), np.inf)


def pairs_within(apart_m: Array, reach_m: float) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Rows and columns of the one-to-one pairs within a reach: most pairs first, then smallest distance. apart_m:
    (N, M), infinite where two are no pair."""
    near = apart_m <= reach_m
    rows, columns = linear_sum_assignment(np.where(near, apart_m, 1e3))
    kept = near[rows, columns]
    return rows[kept], columns[kept]


def _near(objects: Sequence[MapObject], truth: Sequence[TrueObject]) -> list[Pair]:
    """The mapped objects within 1.5 m of a true one of their class on the floor, each with the nearest."""
    standing = [item for item in truth if item.on_floor]
    rows = zip(objects, distances_m(objects, standing), strict=True)
    return [(item, standing[row.argmin()]) for item, row in rows if row.min(initial=np.inf) <= MISPLACED_M]


def _offset_m(item: MapObject, real: TrueObject) -> Array:
    return item.position_m - [real.x_m, real.y_m]


def _mahalanobis2(item: MapObject, real: TrueObject) -> float:
    offset = _offset_m(item, real)
    return float(offset @ np.linalg.solve(item.covariance_m2, offset))


def _figures(rows: Sequence[EvaluationRow], near: Sequence[Pair]) -> dict[str, Any]:
    counts = Counter(row.state for row in rows)
    found, misplaced = [row for row in rows if row.state == "found"], counts["misplaced"]
    errors = [row.error_m for row in found if row.error_m is not None]
    nees = [_mahalanobis2(*pair) / 2.0 for pair in near]
    ellipses = [np.pi * CHI2_95 * float(np.sqrt(np.linalg.det(item.covariance_m2))) for item, _ in near]
    mapped, true = len(found) + misplaced + counts["extra"], len(found) + misplaced + counts["missed"]
    return {
        "precision": share(len(found), mapped),
        "recall": share(len(found), true),
        "f1": share(2 * len(found), mapped + true),
        "median_error_m": round(float(np.median(errors)), 4) if errors else None,
        "p90_error_m": round(float(np.percentile(errors, 90)), 4) if errors else None,
        "covered95": share(sum(bool(row.covered) for row in found), len(found)),
        "anees": round(float(np.mean(nees)), 4) if nees else None,
        "ellipse_m2": round(float(np.mean(ellipses)), 4) if ellipses else None,
        "objects_mapped": mapped,
        "objects_true": true,
        "objects_found": len(found),
    }


def share(part: int, whole: int) -> float | None:
    """A part of a whole as figures have it; None of nothing."""
    return round(part / whole, 4) if whole else None
