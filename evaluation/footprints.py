"""Scores of mapped footprints against the true ones: overlap and yaw."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy.optimize import linear_sum_assignment

from edgemap.evaluation.objects import FOUND_M, TrueObject, pairs_within, scored
from edgemap.geometry.arrays import Array
from edgemap.geometry.grid.rooms import inside
from edgemap.geometry.map_object import MapObject, outline_m

LEAST_IOU = 0.25  # of a mapped footprint that is right
JUDGED = frozenset({"bed", "couch", "dining table", "refrigerator"})  # whose yaw is judged
SQUARE = 1.2  # ratio of sides up to which a quarter turn makes no difference
SAMPLES = 50  # along each side of the area that two footprints are compared on


def score_footprints(objects: Sequence[MapObject], truth: Sequence[TrueObject]) -> dict[str, Any] | None:
    """Match by class, one to one, greatest IoU first; None where no truth has a footprint.

    f1_iou25: of pairs with an IoU of at least 0.25; true objects that are visible too seldom are ignored. mean_iou:
    over objects found within 0.5 m. yaw_error_deg: median over couches, beds, tables and refrigerators found with a
    yaw, of the rectangle's axes; oriented: the share of these that have one.
    """
    with_area = [item for item in truth if item.footprint_m and item.on_floor]
    if not with_area:
        return None
    right, mapped, true, overlaps, errors, judged = 0, 0, 0, list[float](), list[float](), 0
    for label in sorted({item.label for item in objects} | {item.label for item in with_area}):
        ours = [item for item in objects if item.label == label]
        theirs = [item for item in with_area if item.label == label]
        wanted = scored(theirs)
        shares = np.array([[iou(outline_m(a), np.array(b.footprint_m)) for b in theirs] for a in ours])
        shares = shares.reshape(len(ours), len(theirs))
        counts = np.array([item in wanted for item in theirs], dtype=bool)
        # A true object that does not count takes a mapped one only where none that counts does.
        rows, columns = linear_sum_assignment(-np.where(shares >= LEAST_IOU, shares + 10.0 * counts, 0.0))
        taken = [(a, b) for a, b in zip(rows, columns, strict=True) if shares[a, b] >= LEAST_IOU]
        right += sum(bool(counts[b]) for _, b in taken)
        mapped += len(ours) - sum(not counts[b] for _, b in taken)
        true += len(wanted)
        for a, b in pairs_within(ours, wanted, FOUND_M):
            overlaps.append(float(shares[a, theirs.index(wanted[b])]))
            if label in JUDGED:
                judged += 1
                if ours[a].footprint.yaw_rad is not None:
                    errors.append(yaw_error_deg(outline_m(ours[a]), np.array(wanted[b].footprint_m)))
    return {
        "f1_iou25": round(2.0 * right / (mapped + true), 4) if mapped + true else None,
        "mean_iou": round(float(np.mean(overlaps)), 4) if overlaps else None,
        "yaw_error_deg": round(float(np.median(errors)), 2) if errors else None,
        "yaw_errors_deg": [round(error, 2) for error in sorted(errors)],
        "oriented": round(len(errors) / judged, 4) if judged else None,
    }


def iou(a: Array, b: Array) -> float:
    """Intersection over union of two convex polygons (N, 2) and (M, 2), counter-clockwise, by samples."""
    low, high = np.minimum(a.min(axis=0), b.min(axis=0)), np.maximum(a.max(axis=0), b.max(axis=0))
    if (np.ptp(a, axis=0) + np.ptp(b, axis=0) < high - low).any():
        return 0.0
    steps = (np.arange(SAMPLES) + 0.5) / SAMPLES
    places = low + np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2) * (high - low)
    in_a, in_b = inside(a, places), inside(b, places)
    return float((in_a & in_b).sum() / max((in_a | in_b).sum(), 1))


def yaw_error_deg(mapped: Array, true: Array) -> float:
    """Angle between the longer sides of two rectangles (4, 2); between any two where the true one is about square."""
    angles, turn = [], np.pi
    for corners in (mapped, true):
        sides = corners[1:3] - corners[:2]
        lengths = np.linalg.norm(sides, axis=1)
        x_m, y_m = sides[lengths.argmax()]
        angles.append(np.arctan2(y_m, x_m))
        turn = np.pi / 2.0 if lengths.max() < SQUARE * lengths.min() else np.pi
    off = (angles[0] - angles[1] + turn / 2.0) % turn - turn / 2.0
    return float(np.degrees(abs(off)))
