"""What an object's sightings boil down to: pooled by the spot of floor they say and the side they were seen from.

A pool is a sum, so it does not depend on the order of the sightings; how many there are follows the floor and not time.
"""

import math
from collections import Counter
from collections.abc import Sequence
from itertools import islice

import numpy as np

from edgemap.geometry.arrays import Array
from edgemap.geometry.objects.map_object import MapObject, SightingSums
from edgemap.geometry.observations.class_extents import footprint_m
from edgemap.geometry.observations.sighting import PlacedSighting
from edgemap.geometry.slam.keyframes import TrajectoryCorrection

View = tuple[float, float, float]  # stamp_s, x_m, y_m of the base; the stamp says with which pose it moves
Key = tuple[int, int, int, int, int]  # cell x, cell y, side, track, rank among the frame's sightings there

CELL_M = 0.25  # side of the cells: under the distance of two chairs, over a good sighting's error
SIDES = 8  # of an object: sightings from one side share what the class's shape gets wrong
VIEW_M = 0.5  # side of the squares in which places that an object was seen from are remembered
MAXIMUM_VIEWS = 16  # of a pool: old ones were placed by poses that are known less well by now
DIRECTIONS = 24  # from an object; for each the farthest position that it was seen from is reported
SAVED_SIDE = -1


def keys_of(sightings: Sequence[PlacedSighting]) -> list[Key]:
    """The pool of each sighting of one frame and label; two boxes of one frame are never in one pool."""
    keys: list[Key] = [(0, 0, 0, 0, 0)] * len(sightings)
    taken: Counter[tuple[int, int, int, int]] = Counter()
    for row in sorted(range(len(sightings)), key=lambda row: tuple(sightings[row].position_map_m)):
        x_m, y_m = sightings[row].position_map_m
        lever_x_m, lever_y_m = sightings[row].lever_m
        side = int((math.atan2(lever_y_m, lever_x_m) / math.tau + 0.5) * SIDES) % SIDES
        spot = *_cell(x_m, y_m), side, sightings[row].track
        keys[row] = (*spot, taken[spot])
        taken[spot] += 1
    return keys


class ObservationPool:
    """Sightings of one pool, summed.

    information (3,): xx, xy, yy of their pixel information, 1/m^2; vector (2,): that times position. shared: (2, 2)
    m^2 from the mount, weighted by information; variance_m2: mean of what the pose's covariance makes of each.
    first_m2: (2, 2), all that it makes of the earliest one. anchor_s: mean stamp, of the pose that it moves with.
    landmark: of loop closure, that they are observations of; -1 for none. beside: pools seen in one frame with it.
    views: squares they were seen from, each with the newest place in it, the newest `MAXIMUM_VIEWS` only. saved: the
    earlier map's object this is, if it is one. row: in its index. updated: number of the last frame.
    due: sightings at which it is associated again.
    """

    __slots__ = (
        "anchor_s", "beside", "due", "extent_m", "first_m2", "information", "key", "landmark", "row", "saved", "shared",
        "sums", "updated", "variance_m2", "vector", "views", "weight",
    )  # fmt: skip

    def __init__(self, key: Key, extent_m: float, saved: MapObject | None = None) -> None:
        self.key, self.extent_m, self.saved = key, extent_m, saved
        self.information, self.vector = np.zeros(3), np.zeros(2)
        self.shared, self.weight, self.variance_m2 = np.zeros((2, 2)), 0.0, 0.0
        self.first_m2 = np.zeros((2, 2))
        self.sums = SightingSums()
        self.beside: dict[ObservationPool, None] = {}
        self.row, self.landmark = -1, key[3]
        self.views: dict[tuple[int, int], View] = {}
        self.updated, self.anchor_s, self.due = 0, 0.0, 0

    @classmethod
    def of_saved(cls, number: int, item: MapObject, systematic_m: float, correlated: float) -> "ObservationPool":
        """An object of an earlier map, ready for more sightings.

        A map does not say which part of its uncertainty its objects share: all of it but the systematic one counts as
        this object's own, and the new drive's pose as independent of it.
        """
        known = cls((number, 0, SAVED_SIDE, -1, 0), max(footprint_m(item.label, item.width_m)), item)
        own_m2 = positive(item.covariance_m2 - np.eye(2) * systematic_m**2, least=1e-4)
        (xx, xy), (_, yy) = np.linalg.inv(own_m2 / min(correlated, max(float(item.count), 1.0)))
        known.information = np.array([xx, xy, yy])
        known.vector = np.array([[xx, xy], [xy, yy]]) @ item.position_m
        known.weight = xx + yy
        known.sums = SightingSums.of_saved(item)
        known.views = {_square(x_m, y_m): (-math.inf, x_m, y_m) for x_m, y_m in item.seen_from_m}
        return known

    def is_apart(self, other: "ObservationPool") -> bool:
        """Whether the two are certainly two objects: seen in one frame, or separate in an earlier map."""
        return other in self.beside or (self.saved is not None and other.saved is not None)

    def add(self, placed: PlacedSighting, frame: int) -> None:
        """Take in one more sighting."""
        (a, b), (_, c) = placed.covariance_m2
        xx, xy, yy = np.array([c, -b, a]) / (a * c - b * b)
        x_m, y_m = placed.position_map_m
        self.information += (xx, xy, yy)
        self.vector += (xx * x_m + xy * y_m, xy * x_m + yy * y_m)
        self.shared += (xx + yy) * placed.shared_m2
        self.weight += xx + yy
        pose_m2 = placed.from_pose(placed.pose_covariance)
        if placed.sighting.stamp_s < self.sums.first_seen_s:
            self.first_m2 = pose_m2
        self.sums.add(placed)
        self.anchor_s += (placed.sighting.stamp_s - self.anchor_s) / self.sums.count
        self.variance_m2 += (mean_variance(pose_m2) - self.variance_m2) / self.sums.count
        from_x_m, from_y_m = x_m - placed.lever_m[0], y_m - placed.lever_m[1]
        square = _square(from_x_m, from_y_m)
        self.views.pop(square, None)
        self.views[square] = placed.sighting.stamp_s, from_x_m, from_y_m
        if len(self.views) > MAXIMUM_VIEWS:
            del self.views[next(iter(self.views))]
        self.updated = frame

    @property
    def position_m(self) -> Array:
        """Information-weighted mean of the sightings, (2,)."""
        (xx, xy, yy), (vx, vy) = self.information, self.vector
        return np.array([yy * vx - xy * vy, xx * vy - xy * vx]) / (xx * yy - xy * xy)

    def move(self, by_m: Array, pose_m2: Array) -> None:
        """It lies elsewhere by (2,), and the poses that it was seen from add this (2, 2) to its covariance."""
        (xx, xy, yy), (dx, dy) = self.information, by_m
        self.vector += (xx * dx + xy * dy, xy * dx + yy * dy)
        self.variance_m2, self.first_m2 = mean_variance(pose_m2), pose_m2

    def join(self, other: "ObservationPool") -> None:
        """Take in another pool's sightings."""
        counts = self.sums.count, other.sums.count
        self.variance_m2 = float(np.average([self.variance_m2, other.variance_m2], weights=counts))
        if other.sums.first_seen_s < self.sums.first_seen_s:
            self.first_m2 = other.first_m2
        self.anchor_s = max((self, other), key=lambda pool: pool.weight).anchor_s
        self.information, self.vector = self.information + other.information, self.vector + other.vector
        self.shared, self.weight = self.shared + other.shared, self.weight + other.weight
        self.sums.join(other.sums)
        views = sorted((other.views | self.views).items(), key=lambda item: item[1][0])
        self.views = dict(views[-MAXIMUM_VIEWS:])
        self.saved = self.saved or other.saved
        self.updated = max(self.updated, other.updated)


def move_views(pools: Sequence[ObservationPool], correction: TrajectoryCorrection) -> None:
    """The places that pools were seen from move as the trajectory does: exactly, or rounding would carry them away."""
    views = np.array([view for pool in pools for view in pool.views.values()]).reshape(-1, 3)
    views[:, 1:] = correction.moved_points(views[:, 0], views[:, 1:])
    rows = iter(views.tolist())
    for pool in pools:
        moved = [(stamp_s, x_m, y_m) for stamp_s, x_m, y_m in islice(rows, len(pool.views))]
        pool.views = {_square(x_m, y_m): (stamp_s, x_m, y_m) for stamp_s, x_m, y_m in moved}


def outermost(places_m: Sequence[tuple[float, float]], position_m: Array) -> tuple[tuple[float, float], ...]:
    """Of places (x, y) that an object at (2,) was seen from, the farthest in each direction, in the order given: from
    the nearer ones it was seen over the same floor."""
    x_m, y_m = position_m
    farthest: dict[int, tuple[float, int]] = {}
    for row, (from_x_m, from_y_m) in enumerate(places_m):
        dx_m, dy_m = from_x_m - x_m, from_y_m - y_m
        direction = int((math.atan2(dy_m, dx_m) / math.tau + 0.5) * DIRECTIONS) % DIRECTIONS
        farthest[direction] = max(farthest.get(direction, (-1.0, 0)), (dx_m * dx_m + dy_m * dy_m, row))
    return tuple(places_m[row] for row in sorted(row for _, row in farthest.values()))


def mean_variance(covariance: Array) -> float:
    """Mean of both axes' variances of a covariance (2, 2)."""
    return float(covariance[0, 0] + covariance[1, 1]) / 2.0


def positive(matrix: Array, least: float = 0.0) -> Array:
    """The nearest symmetric matrix with no eigenvalue below `least`."""
    values, vectors = np.linalg.eigh((matrix + matrix.T) / 2.0)
    return (vectors * np.maximum(values, least)) @ vectors.T


def _cell(x_m: float, y_m: float) -> tuple[int, int]:
    return math.floor(x_m / CELL_M), math.floor(y_m / CELL_M)


def _square(x_m: float, y_m: float) -> tuple[int, int]:
    return math.floor(x_m / VIEW_M), math.floor(y_m / VIEW_M)
