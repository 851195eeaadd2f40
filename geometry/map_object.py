"""The objects of the map: position, size, identity."""

import math
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from edgemap.geometry.arrays import Array
from edgemap.geometry.observations.class_extents import footprint_m
from edgemap.geometry.observations.sighting import PlacedSighting
from edgemap.geometry.se2 import SE2, wrap_angle

CHI2_95 = 5.991  # 95 % quantile of the squared Mahalanobis distance in two dimensions
CIRCLE = 32  # corners of a footprint whose yaw is unknown
REPEATED = 4.0  # consecutive pictures of 0.1 s that weigh as much as one: each repeats the error of the previous one


EventKind = Literal[
    "appeared", "moved", "vanished", "missed", "restored", "named", "confirmed", "corrected", "added", "merged"
]
Place = tuple[float, float]


def as_places(points_m: ArrayLike) -> tuple[Place, ...]:
    """Points (N, 2) as plain numbers."""
    return tuple((float(x), float(y)) for x, y in np.reshape(points_m, (-1, 2)))


@dataclass(frozen=True, slots=True)
class MapEvent:
    """An entry of an object's history. at: seconds since 1970, None where unknown. by: who observed or stated it.
    from_m, to_m: position before and after, map frame. other: id of the object that it was before it moved, or that
    became part of it.

    vanished: no longer in its place, and the floor there is free. missed: not detected in its place, which may have
    been hidden; it stays on the map where a person has named or confirmed it. restored: first observed again by a later
    run.
    """

    what: EventKind
    at: float | None = None
    by: Literal["sensor", "person"] = "sensor"
    from_m: Place | None = None
    to_m: Place | None = None
    other: str = ""


@dataclass(frozen=True, slots=True)
class ObjectFootprint:
    """A rectangle about an object's position. width_m: across its front. depth_m: along it. yaw_rad: direction of the
    front, map frame; None where unknown. yaw_sigma_rad: standard deviation, infinite then, or where a person states it.
    """

    width_m: float
    depth_m: float
    yaw_rad: float | None = None
    yaw_sigma_rad: float = math.inf


@dataclass(frozen=True, slots=True, eq=False)
class MapObject:
    """One object on the floor. position_m: (2,), x and y, map frame. covariance_m2: (2, 2), of the position.

    width_m, height_m: mean apparent size. count: sightings. confidence: 0..1. Stamps in seconds. seen_from_m: (x, y)
    positions from which it was observed, the farthest in each direction; older maps have none. labels: probability of
    each detected class. name, confirmed: edited by a person. corrected: which of label, position, size and yaw a
    person has set. yaw_rad: direction of the front. depth_m: depth of the footprint. Only a person sets yaw_rad and
    depth_m; measured ones are in `measured`, and `footprint` gives what counts. first_seen, last_seen:
    of all runs, seconds since 1970, None where unknown. since: it has stood in its place from then until last_seen, by
    what each run between has observed; None where unknown. history: oldest first. earlier: not observed by this run, so
    that its stamps are of an earlier run's stream.
    """

    id: str
    label: str
    position_m: Array
    covariance_m2: Array
    width_m: float
    height_m: float
    count: int
    confidence: float
    first_seen_s: float
    last_seen_s: float
    seen_from_m: tuple[tuple[float, float], ...] = ()
    labels: Mapping[str, float] = field(default_factory=dict)
    name: str = ""
    confirmed: bool = False
    corrected: tuple[str, ...] = ()
    yaw_rad: float | None = None
    depth_m: float | None = None
    first_seen: float | None = None
    last_seen: float | None = None
    since: float | None = None
    history: tuple[MapEvent, ...] = ()
    earlier: bool = False
    measured: ObjectFootprint | None = None

    @property
    def x_m(self) -> float:
        """Forward of the map's origin, metres."""
        return float(self.position_m[0])

    @property
    def y_m(self) -> float:
        """Left of the map's origin, metres."""
        return float(self.position_m[1])

    @property
    def place_m(self) -> Place:
        """The position as plain numbers."""
        return self.x_m, self.y_m

    @property
    def footprint(self) -> ObjectFootprint:
        """Sides and yaw, each as a person has set it, else as measured; else the sides that are usual for the class."""
        shape = self.measured or ObjectFootprint(*footprint_m(self.label, self.width_m))
        if self.depth_m is not None:
            shape = replace(shape, width_m=self.width_m, depth_m=self.depth_m)
        return shape if self.yaw_rad is None else replace(shape, yaw_rad=self.yaw_rad, yaw_sigma_rad=math.inf)

    @property
    def former_ids(self) -> set[str]:
        """Ids that it had before it was moved."""
        return {event.other for event in self.history if event.what == "moved" and event.other}

    def transformed(self, pose: SE2, factor: float = 1.0) -> "MapObject":
        """The object with lengths and standard deviations times `factor`, in a frame in which the origin of its current
        one has this pose. A size that a person has set stays."""

        def at(place_m: Place | None) -> Place | None:
            return place_m and as_places(pose.apply(factor * np.array(place_m)))[0]

        def turned(yaw_rad: float | None) -> float | None:
            return None if yaw_rad is None else wrap_angle(yaw_rad + pose.yaw_rad)

        rotation, shape = pose.rotation(), self.measured
        if shape is not None:
            sides = {"width_m": factor * shape.width_m, "depth_m": factor * shape.depth_m}
            shape = replace(shape, **sides, yaw_rad=turned(shape.yaw_rad))
        size_factor = 1.0 if "size" in self.corrected else factor
        return replace(
            self, position_m=pose.apply(factor * self.position_m),
            covariance_m2=factor**2 * (rotation @ self.covariance_m2 @ rotation.T),
            width_m=size_factor * self.width_m, height_m=size_factor * self.height_m, measured=shape,
            seen_from_m=as_places(pose.apply(factor * np.reshape(self.seen_from_m, (-1, 2)))),
            yaw_rad=turned(self.yaw_rad),
            history=tuple(replace(event, from_m=at(event.from_m), to_m=at(event.to_m)) for event in self.history),
        )  # fmt: skip


@dataclass(slots=True)
class SightingSums:
    """Sums over the sightings of an object. They give its size, confidence and times, and can be joined."""

    count: int = 0
    pictures: float = 0.0
    weight: float = 0.0
    width_m: float = 0.0
    height_m: float = 0.0
    miss: float = 0.0
    first_seen_s: float = math.inf
    last_seen_s: float = -math.inf

    @classmethod
    def of_saved(cls, item: MapObject) -> "SightingSums":
        """The sums of an object that was loaded from an earlier map."""
        count, sizes_m = item.count, (item.width_m * item.count, item.height_m * item.count)
        miss = math.log1p(-min(item.confidence, 1.0 - 1e-9))
        return cls(count, float(count), float(count), *sizes_m, miss, item.first_seen_s, item.last_seen_s)

    def add(self, placed: PlacedSighting) -> None:
        """Adds one sighting."""
        seen = placed.sighting
        miss = math.log1p(-min(seen.score, 0.999)) / REPEATED
        sums = seen.pictures, seen.weight * seen.pictures, seen.width_m, seen.height_m, miss * seen.pictures
        self.join(SightingSums(1, *sums, seen.stamp_s, seen.stamp_s))

    def join(self, other: "SightingSums") -> None:
        """Adds another object's sums."""
        self.count += other.count
        self.pictures += other.pictures
        self.weight += other.weight
        self.width_m += other.width_m
        self.height_m += other.height_m
        self.miss += other.miss
        self.first_seen_s = min(self.first_seen_s, other.first_seen_s)
        self.last_seen_s = max(self.last_seen_s, other.last_seen_s)

    @property
    def confidence(self) -> float:
        """1 - product of (1 - score), with one factor for each 0.4 s in view."""
        return -math.expm1(self.miss)

    @property
    def score_log_odds(self) -> float:
        """Log-odds of the mean score of the sightings. The mean score is 1 - geometric mean of (1 - score)."""
        missed = min(REPEATED * self.miss / self.pictures, -1e-9)
        return math.log(-math.expm1(missed)) - missed

    def as_object(self, identity: str, label: str, position_m: Array, covariance_m2: Array) -> MapObject:
        """The object that these sums describe."""
        return MapObject(
            identity, label, position_m, covariance_m2, self.width_m / self.count, self.height_m / self.count,
            self.count, self.confidence, self.first_seen_s, self.last_seen_s,
        )  # fmt: skip


def ellipse_95(covariance_m2: Array) -> tuple[float, float, float]:
    """The 95 % ellipse of a position: longer and shorter half axis, m, and yaw of the longer one, rad."""
    (xx, xy), (_, yy) = covariance_m2[:2, :2].tolist()
    mean, half_difference = (xx + yy) / 2.0, math.hypot((xx - yy) / 2.0, xy)
    long_m, short_m = (
        math.sqrt(CHI2_95 * max(value, 0.0)) for value in (mean + half_difference, mean - half_difference)
    )
    return long_m, short_m, 0.5 * math.atan2(2.0 * xy, xx - yy)


def id_order(identity: str) -> tuple[str, int]:
    """Sort key of ids such as `chair-12`: by label, then by number; a foreign id counts as a label with number 0."""
    label, _, number = identity.rpartition("-")
    return (label, int(number)) if number.isdecimal() else (identity, 0)


class Ids(Counter[str]):
    """Issues ids such as `chair-3`, none of them twice: the highest number of each label so far. taken: ids in use."""

    def __init__(self, taken: Iterable[str] = ()) -> None:
        super().__init__()
        for label, number in map(id_order, taken):
            self[label] = max(self[label], number)

    def new(self, label: str) -> str:
        """The next id of a label."""
        self[label] += 1
        return f"{label}-{self[label]}"


def outline_m(item: MapObject) -> Array:
    """Corners of an object's footprint, counter-clockwise, map frame: its rectangle (4, 2), front right corner first;
    where its yaw is unknown the circle (`CIRCLE`, 2) of the same area."""
    shape = item.footprint
    if shape.yaw_rad is None:
        around = np.arange(CIRCLE) * (2.0 * math.pi / CIRCLE)
        return item.position_m + radius_m(item) * np.column_stack([np.cos(around), np.sin(around)])
    width, depth = shape.width_m, shape.depth_m
    corners = np.array([(depth, -width), (depth, width), (-depth, width), (-depth, -width)]) / 2.0
    return SE2(*item.place_m, shape.yaw_rad).apply(corners)


def reach_m(item: MapObject) -> float:
    """Greatest distance of an object's footprint from its position, m."""
    shape = item.footprint
    return radius_m(item) if shape.yaw_rad is None else math.hypot(shape.width_m, shape.depth_m) / 2.0


def radius_m(item: MapObject) -> float:
    """Radius of the circle around an object's position with the same area as its footprint, m; at least 5 cm."""
    shape = item.footprint
    return max(math.sqrt(shape.width_m * shape.depth_m / math.pi), 0.05)
