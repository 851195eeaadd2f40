"""Usual dimensions of a class: footprint, apparent width, and distance from the lower edge to the centre."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from edgemap.geometry.arrays import Array

# Usual footprint of a class, width and depth in metres; a class without one gets the box's width for both.
FOOTPRINT_M = {
    "chair": (0.50, 0.50), "couch": (2.00, 0.90), "potted plant": (0.40, 0.40), "bed": (1.60, 2.00),
    "dining table": (1.40, 0.90), "toilet": (0.40, 0.65), "tv": (1.00, 0.25), "refrigerator": (0.65, 0.65),
    "oven": (0.60, 0.60), "sink": (0.60, 0.50), "bench": (1.40, 0.50), "suitcase": (0.45, 0.30),
    "backpack": (0.35, 0.25), "vase": (0.20, 0.20), "bicycle": (1.70, 0.50), "motorcycle": (2.00, 0.80),
    "car": (4.20, 1.80), "truck": (7.00, 2.50), "bus": (11.00, 2.60),
}  # fmt: skip
# No object of these classes is wider, however it stands; of others (beds, couches, tables) there are always wider ones.
WIDEST_M = {
    "backpack": 0.8, "chair": 1.3, "oven": 1.2, "refrigerator": 1.6, "suitcase": 1.0, "toilet": 1.0, "vase": 0.8,
}  # fmt: skip
# Usual height in metres, and standard deviation as a share of the mean of a home's: the furniture of 28 rendered homes,
# and everyday sizes, which scatter more (desks and low tables are tables, hot plates are ovens).
HEIGHT_M = {
    "chair": (0.85, 0.12), "couch": (0.82, 0.10), "dining table": (0.74, 0.15), "bench": (0.85, 0.20),
    "bed": (0.85, 0.35), "toilet": (0.76, 0.10), "refrigerator": (1.60, 0.35), "oven": (0.88, 0.12),
    "backpack": (0.44, 0.15), "suitcase": (0.63, 0.22), "potted plant": (0.65, 0.30), "vase": (0.31, 0.25),
    "bicycle": (1.05, 0.12), "motorcycle": (1.15, 0.12), "car": (1.50, 0.12), "person": (1.68, 0.10),
}  # fmt: skip
TABLES, SEATS = frozenset({"dining table"}), frozenset({"chair", "bench"})


class Shapes(NamedTuple):
    """Apparent shapes of objects for a camera near the floor, (N,) each, all in metres.

    reach, reach_per_width: the middle of the footprint lies `reach + reach_per_width * apparent width` behind the
    middle of the box's lower edge. width, width_sigma: usual apparent width (eq. 4), over all sides.
    """

    reach: Array
    reach_per_width: Array
    width: Array
    width_sigma: Array

    def reach_m(self, widths_m: Array) -> Array:
        """Distance from the box's lower edge to the centre of the footprint, for apparent widths."""
        widest = self.width + 2.0 * self.width_sigma
        return np.maximum(self.reach + self.reach_per_width * np.minimum(widths_m, widest), 0.0)

    def missing_m(self, widths_m: Array) -> Array:
        """Part of the usual width that an apparent width lacks."""
        return np.maximum(self.width - widths_m, 0.0)

    def cut_sigma_m(self, widths_m: Array) -> Array:
        """Standard deviation of the centre of an object that the picture's border cuts."""
        return 0.5 * self.width_sigma + 0.25 * self.missing_m(widths_m)


# Least squares on about 2,000 clean boxes (not cut by the picture, nothing hidden, nearer than 6 m) of the 2,712 in 22
# rendered homes, seeds 8000-8021, training furniture. Some classes had few: bed 13, toilet 6, refrigerator 26; those
# are rounded by judgement. Fields of `Shapes`.
MEASURED = {
    "backpack": (0.06, 0.00, 0.30, 0.06),
    "bed": (1.18, -0.20, 1.05, 0.36),
    "chair": (0.13, 0.23, 0.58, 0.14),
    "couch": (0.87, -0.15, 1.61, 0.35),
    "dining table": (0.08, 0.36, 0.95, 0.32),
    "oven": (0.33, 0.00, 0.57, 0.14),
    "potted plant": (0.12, 0.00, 0.48, 0.21),
    "refrigerator": (0.31, 0.00, 0.79, 0.14),
    "suitcase": (0.12, 0.25, 0.49, 0.18),
    "toilet": (0.15, 0.00, 0.50, 0.15),
    "vase": (0.06, 0.00, 0.28, 0.06),
}


def footprint_m(label: str, width_m: float) -> tuple[float, float]:
    """Width and depth in metres: the class's usual footprint, or a square of its apparent width, at most 1 m."""
    unknown_m = min(width_m, 1.0)
    return FOOTPRINT_M.get(label, (unknown_m, unknown_m))


def extent_m(label: str, width_m: float) -> float:
    """The longer side of `footprint_m`."""
    return max(footprint_m(label, width_m))


def shares_floor(a: str, b: str) -> bool:
    """Whether objects of two classes may stand on the same floor: seats are pushed under tables."""
    return {a, b} <= TABLES | SEATS and (a in TABLES) != (b in TABLES)


def shapes_of(labels: Sequence[str], widths_m: Array) -> Shapes:
    """The shapes of classes as measured; else guessed from the usual footprint; else from the apparent widths (N,)."""
    shapes = []
    for label, width_m in zip(labels, widths_m.tolist(), strict=True):
        wide, deep = footprint_m(label, width_m)
        shapes.append(MEASURED.get(label, (deep / 2.0, 0.0, (wide + deep) / 2.0, 0.3 * wide)))
    return Shapes(*np.array(shapes).T)
