"""What an object's sightings boil down to: pooled by the spot of floor they say and the side they were seen from.

A pool is a sum, so it does not depend on the order of the sightings; how many there are follows the floor and not time.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from edgemap.geometry.floor_map import MapObject, SightingSums
from edgemap.geometry.footprints import footprint_m
from edgemap.geometry.sighting import PlacedSighting

Array = NDArray[np.float64]
Key = tuple[int, int, int, int]  # cell x, cell y, side, rank among the frame's sightings there

CELL_M = 0.25  # side of the cells: under the distance of two chairs, over a good sighting's error
SIDES = 8  # of an object: sightings from one side share what the class's shape gets wrong
VIEW_M = 0.5  # side of the squares in which places that an object was seen from are remembered
SAVED_SIDE = -1


def keys_of(sightings: Sequence[PlacedSighting]) -> list[Key]:
    """The pool of each sighting of one frame and label; two boxes of one frame are never in one pool."""
    keys: list[Key] = [(0, 0, 0, 0)] * len(sightings)
    taken: Counter[tuple[int, int, int]] = Counter()
    for row in sorted(range(len(sightings)), key=lambda row: tuple(sightings[row].position_map_m)):
        x_m, y_m = sightings[row].position_map_m
        lever_x_m, lever_y_m = sightings[row].lever_m
        side = int((math.atan2(lever_y_m, lever_x_m) / math.tau + 0.5) * SIDES) % SIDES
        spot = math.floor(x_m / CELL_M), math.floor(y_m / CELL_M), side
        keys[row] = (*spot, taken[spot])
        taken[spot] += 1
    return keys


class Evidence:
    """Sightings of one pool, summed.

    information (3,): xx, xy, yy of their pixel information, 1/m^2; vector (2,): that times position. shared: (2, 2)
    m^2 from the mount, weighted by information; variance_m2: mean of what the pose's covariance makes of each. first:
    the earliest one. beside: pools seen in one frame with it. views: squares they were seen from. saved: the earlier
    map's object this is, if it is one. updated: number of the last frame.
    """

    __slots__ = (
        "beside", "extent_m", "first", "information", "key", "saved", "shared", "sums", "updated", "variance_m2",
        "vector", "views", "weight",
    )  # fmt: skip

    def __init__(self, key: Key, extent_m: float, saved: MapObject | None = None) -> None:
        self.key, self.extent_m, self.saved = key, extent_m, saved
        self.information, self.vector = np.zeros(3), np.zeros(2)
        self.shared, self.weight, self.variance_m2 = np.zeros((2, 2)), 0.0, 0.0
        self.first: PlacedSighting | None = None
        self.sums = SightingSums()
        self.beside: set[Key] = set()
        self.views: set[tuple[int, int]] = set()
        self.updated = 0

    @classmethod
    def of_saved(cls, number: int, item: MapObject, systematic_m: float, correlated: float) -> Evidence:
        """An object of an earlier map, ready for more sightings.

        A map does not say which part of its uncertainty its objects share: all of it but the systematic one counts as
        this object's own, and the new drive's pose as independent of it.
        """
        known = cls((number, 0, SAVED_SIDE, 0), max(footprint_m(item.label, item.width_m)), item)
        spread = positive(item.covariance_m2 - np.eye(2) * systematic_m**2, least=1e-4)
        (xx, xy), (_, yy) = np.linalg.inv(spread / min(correlated, max(float(item.count), 1.0)))
        known.information = np.array([xx, xy, yy])
        known.vector = np.array([[xx, xy], [xy, yy]]) @ item.position_m
        known.weight = xx + yy
        known.sums = SightingSums.of_saved(item)
        known.views = {_square(x_m, y_m) for x_m, y_m in item.seen_from_m}
        return known

    def add(self, placed: PlacedSighting, frame: int) -> None:
        """Take in one more sighting."""
        (a, b), (_, c) = placed.covariance_m2
        xx, xy, yy = np.array([c, -b, a]) / (a * c - b * b)
        x_m, y_m = placed.position_map_m
        self.information += (xx, xy, yy)
        self.vector += (xx * x_m + xy * y_m, xy * x_m + yy * y_m)
        self.shared += (xx + yy) * placed.shared_m2
        self.weight += xx + yy
        if self.first is None or placed.sighting.stamp_s < self.first.sighting.stamp_s:
            self.first = placed
        self.sums.add(placed)
        self.variance_m2 += (pose_variance_m2(placed) - self.variance_m2) / self.sums.count
        self.views.add(_square(x_m - placed.lever_m[0], y_m - placed.lever_m[1]))
        self.updated = frame


def pose_variance_m2(placed: PlacedSighting) -> float:
    """What the pose's covariance makes of a sighting's place: the mean of both axes' variances."""
    covariance = placed.pose_covariance
    if not covariance.any():
        return 0.0
    return float(np.trace(placed.from_pose(covariance))) / 2.0


def positive(matrix: Array, least: float = 0.0) -> Array:
    """The nearest symmetric matrix with no eigenvalue below `least`."""
    values, vectors = np.linalg.eigh((matrix + matrix.T) / 2.0)
    return (vectors * np.maximum(values, least)) @ vectors.T


def _square(x_m: float, y_m: float) -> tuple[int, int]:
    return math.floor(x_m / VIEW_M), math.floor(y_m / VIEW_M)
