"""Scores of mapped footprints against the true ones: overlap and yaw."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy.optimize import linear_sum_assignment

from edgemap.evaluation.objects import FOUND_M, MINIMUM_FRAMES, TrueObject, distances_m, pairs_within, share
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
    apart_m, counts = distances_m(objects, with_area), np.array([item.frames >= MINIMUM_FRAMES for item in with_area])
    shares = np.zeros(apart_m.shape)
    for a, b in np.argwhere(np.isfinite(apart_m)):
        shares[a, b] = iou(outline_m(objects[a]), np.array(with_area[b].footprint_m))
    # A true object that does not count takes a mapped one only where none that counts does.
    pairs = linear_sum_assignment(-np.where(shares >= LEAST_IOU, shares + 10.0 * counts, 0.0))
    taken = counts[pairs[1]][shares[pairs] >= LEAST_IOU]
    right, mapped = int(taken.sum()), len(objects) - int((~taken).sum())
    found = pairs_within(np.where(counts, apart_m, np.inf), FOUND_M)
    judged = [(objects[a], with_area[b]) for a, b in zip(*found, strict=True) if objects[a].label in JUDGED]
    errors = [
        yaw_error_deg(outline_m(item), np.array(real.footprint_m))
        for item, real in judged
        if item.footprint.yaw_rad is not None
    ]
    return {
        "f1_iou25": share(2 * right, mapped + int(counts.sum())),
        "mean_iou": round(float(shares[found].mean()), 4) if len(found[0]) else None,
        "yaw_error_deg": round(float(np.median(errors)), 2) if errors else None,
        "yaw_errors_deg": [round(error, 2) for error in sorted(errors)],
        "oriented": share(len(errors), len(judged)),
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
