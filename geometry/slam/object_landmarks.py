"""Landmarks: all observations of one object in one visit, from the first sighting on.

A landmark keeps its observations in the frames of the keyframes that made them, one per keyframe, so it moves with the
trajectory. Its position and covariance follow from these and the keyframes' poses.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from edgemap.geometry.arrays import Array, inverse
from edgemap.geometry.map_object import MapObject, SightingSums
from edgemap.geometry.observations.sighting import PlacedSighting
from edgemap.geometry.se2 import SE2
from edgemap.geometry.slam.least_squares import ObservationFactors


class Sums:
    """Columns of an observation's sums."""

    COUNT = slice(0, 1)  # sightings
    INFORMATION = slice(1, 4)  # xx, xy, yy
    VECTOR = slice(4, 6)  # information times position
    BIAS = slice(6, 8)
    RANGE = slice(8, 10)
    BY_TILT = slice(10, 14)  # derivative by the mount's tilt
    TILTED = slice(14, 16)  # that times the tilt it was placed by
    VIEW = slice(16, 18)  # the base's position at the first
    OUTLINED = slice(18, 19)  # how many have an outline
    OUTLINE = slice(19, 25)  # sum of these
    COLUMNS = 25


@dataclass(frozen=True, slots=True)
class LandmarkRule:
    """Errors of landmarks beyond those of their sightings."""

    reach_m: float = 1.0  # greatest distance of two positions of one object
    # Standard deviation of the distance of an object's centres as observed from two sides, as a share of its longer
    # side: no box shows the footprint, and more sightings do not reduce it.
    side_share: float = 0.2
    # Standard deviation per keyframe that the view adds to its sightings' covariances, m; a visit ends where odometry
    # may have slipped by as much since the last sighting.
    view_m: float = 0.15
    # Share of a range's variance that all observations of a landmark have in common: a box that ends too low does so
    # from frame to frame (0.5 to 0.8 over 20,000 sightings of six homes).
    repeated: float = 0.65

    def side_m2(self, extent_m: float) -> float:
        """Variance of the distance of an object's centres as observed from two sides, per axis, m^2."""
        return (self.side_share * extent_m) ** 2

    def centre_m2(self, extent_m: float) -> float:
        """Variance of an object's centre as observed from one of them, per axis, m^2."""
        return self.side_m2(extent_m) / 2.0


@dataclass(slots=True, eq=False)
class Landmark:
    """One object in one visit. keyframes (N,): rows of the trajectory that observed it; rows (N, Sums.COLUMNS): sums of
    the sightings of each. observed_at_m: the odometer at the last sighting. sums: evidence. distinct: numbers of
    landmarks of its label observed in the same frame, so other objects. saved: the object of an earlier map, which has
    no observations here. gone: marked for removal.

    position_m (2,), own_m2 (2, 2): for fixed keyframe poses. first_m2 (2, 2), variance_m2: what the pose of the first
    observation, and of all in the mean, adds. shared_m2 (2, 2): what the mount adds.
    """

    number: int
    label: str
    extent_m: float
    observed_at_m: float
    saved: MapObject | None = None
    keyframes: list[int] = field(default_factory=list)
    rows: Array = field(default_factory=lambda: np.zeros((0, Sums.COLUMNS)))
    sums: SightingSums = field(default_factory=SightingSums)
    distinct: set[int] = field(default_factory=set)
    gone: bool = False
    position_m: Array = field(default_factory=lambda: np.zeros(2))
    own_m2: Array = field(default_factory=lambda: np.zeros((2, 2)))
    first_m2: Array = field(default_factory=lambda: np.zeros((2, 2)))
    shared_m2: Array = field(default_factory=lambda: np.zeros((2, 2)))
    variance_m2: float = 0.0

    @property
    def first(self) -> int:
        """The first keyframe that observed it; -1 for an earlier map's."""
        return self.keyframes[0] if self.keyframes else -1

    @property
    def last(self) -> int:
        """The newest keyframe that observed it; -1 for an earlier map's."""
        return self.keyframes[-1] if self.keyframes else -1

    def is_distinct(self, other: "Landmark") -> bool:
        """Whether the two are certainly distinct: observed in one frame, or separate in an earlier map."""
        return other.number in self.distinct or (self.saved is not None and other.saved is not None)

    def add(self, keyframe: int, row: Array) -> None:
        """One more sighting, in a keyframe's frame."""
        if not self.keyframes or self.keyframes[-1] != keyframe:
            self.keyframes.append(keyframe)
            self.rows = np.concatenate([self.rows, row[None]])
        else:
            self.rows[-1] = _both(self.rows[-1], row)

    def join(self, other: "Landmark") -> None:
        """Adds the observations of another visit to the same object. Together they are as much evidence as the better
        one, as repeated visits repeat a false detection.
        """
        self._keep([*zip(self.keyframes, self.rows, strict=True), *zip(other.keyframes, other.rows, strict=True)])
        weight = max(self.sums.weight, other.sums.weight)
        self.sums.join(other.sums)
        self.sums.weight = weight
        self.distinct |= other.distinct
        self.observed_at_m = max(self.observed_at_m, other.observed_at_m)

    def move_to(self, onto: Mapping[int, tuple[int, SE2 | None]]) -> bool:
        """Moves each observation to another keyframe's frame. onto: by old row, the new row and the old keyframe's pose
        in the new one's frame, None where it stays. Returns whether any observation moved."""
        moves = [onto[keyframe] for keyframe in self.keyframes]
        rows = zip(moves, self.rows, strict=True)
        self._keep([(new, row if pose is None else _in_frame(row, pose)) for (new, pose), row in rows])
        return any(pose is not None for _, pose in moves)

    def _keep(self, observed: Sequence[tuple[int, Array]]) -> None:
        """Has these observations, each of a keyframe; those of one keyframe add up."""
        rows: dict[int, Array] = {}
        for keyframe, row in observed:
            rows[keyframe] = _both(rows[keyframe], row) if keyframe in rows else row
        self.keyframes = sorted(rows)
        self.rows = np.array([rows[keyframe] for keyframe in self.keyframes]).reshape(-1, Sums.COLUMNS)


def observed(placed: PlacedSighting, since: SE2, tilt_rad: Array, repeated: float) -> Array:
    """A sighting as the row of an observation in the frame of the last keyframe, `since` which the robot moved: what
    all sightings have in common, what those of one landmark have, and the rest."""
    sighting, rotation = placed.sighting, since.rotation()
    place_m = sighting.position_base_m
    values, vectors = np.linalg.eigh(sighting.shared_m2)
    bias_m = vectors[:, 1] * (math.sqrt(max(values[1], 0.0)) * (np.sign(vectors[:, 1] @ place_m) or 1.0))
    along = sighting.covariance_m2 @ place_m
    # A sighting at the base itself has no direction.
    range_m = along * math.sqrt(repeated / max(float(place_m @ along), 1e-12))
    residual_m2 = sighting.covariance_m2 + sighting.shared_m2 - np.outer(bias_m, bias_m) - np.outer(range_m, range_m)
    (a, b), (_, d) = rotation @ residual_m2 @ rotation.T
    determinant = a * d - b * b
    xx, xy, yy = d / determinant, -b / determinant, a / determinant
    x_m, y_m = since.apply(place_m)
    row = np.zeros(Sums.COLUMNS)
    row[:6] = 1.0, xx, xy, yy, xx * x_m + xy * y_m, xy * x_m + yy * y_m
    row[Sums.BIAS], row[Sums.RANGE], row[Sums.VIEW] = rotation @ bias_m, rotation @ range_m, (since.x_m, since.y_m)
    if sighting.outline_base_m is not None and np.isfinite(sighting.outline_base_m).all():
        row[Sums.OUTLINED], row[Sums.OUTLINE] = 1.0, since.apply(sighting.outline_base_m).ravel()
    if placed.mount is not None:
        by_tilt = rotation @ placed.mount.floor_by_tilt(place_m)
        row[Sums.BY_TILT], row[Sums.TILTED] = by_tilt.ravel(), by_tilt @ tilt_rad
    return row


def factors(rows: Array, tilt_rad: Array, view_m: float) -> tuple[Array, Array, Array, Array]:
    """Observations (N, Sums.COLUMNS) as factors: positions (N, 2), information (N, 2, 2), and how one standard
    deviation of the mount's error and of the landmark's range error move each, (N, 2). Repeated frames of one keyframe
    repeat each other's error, so they weigh as one."""
    count = rows[:, 0]
    xx, xy, yy = rows[:, Sums.INFORMATION].T
    vx, vy = rows[:, Sums.VECTOR].T
    scale = 1.0 / (xx * yy - xy * xy)
    place = np.column_stack([(yy * vx - xy * vy) * scale, (xx * vy - xy * vx) * scale])
    place += (rows[:, Sums.BY_TILT].reshape(-1, 2, 2) @ tilt_rad - rows[:, Sums.TILTED]) / count[:, None]
    scale = scale * count
    a, b, d = yy * scale + view_m**2, -xy * scale, xx * scale + view_m**2
    scale = 1.0 / (a * d - b * b)
    information = np.stack([d * scale, -b * scale, -b * scale, a * scale], axis=-1).reshape(-1, 2, 2)
    return place, information, rows[:, Sums.BIAS] / count[:, None], rows[:, Sums.RANGE] / count[:, None]


def observations(landmarks: Sequence[Landmark], tilt_rad: Array, rule: LandmarkRule) -> ObservationFactors:
    """Factors of these landmarks, one for each keyframe that observed one. The error of each includes those of the
    range and of the side from which the object was observed."""
    pose, rows = stacked(landmarks)
    position_m, information, bias_m, range_m = factors(rows, tilt_rad, rule.view_m)
    sizes = [len(one.keyframes) for one in landmarks]
    side_m2 = np.repeat([rule.side_m2(one.extent_m) for one in landmarks], sizes)
    covariance = inverse(information) + range_m[:, :, None] * range_m[:, None] + side_m2[:, None, None] * np.eye(2)
    landmark = np.repeat(np.arange(len(landmarks)), sizes)
    return ObservationFactors(pose, landmark, position_m, inverse(covariance), bias_m)


def stacked(landmarks: Sequence[Landmark]) -> tuple[NDArray[np.intp], Array]:
    """Keyframes (N,) and rows (N, Sums.COLUMNS) of all observations of these landmarks, in their order."""
    keyframes = np.array([keyframe for one in landmarks for keyframe in one.keyframes], dtype=np.intp)
    return keyframes, np.concatenate([np.zeros((0, Sums.COLUMNS)), *(one.rows for one in landmarks)])


def rotations(yaw_rad: Array) -> Array:
    """Rotation matrices (N, 2, 2)."""
    c, s = np.cos(yaw_rad), np.sin(yaw_rad)
    return np.stack([c, -s, s, c], axis=-1).reshape(-1, 2, 2)


def _both(first: Array, second: Array) -> Array:
    """Adds the sums of two observations, in the frame of the first."""
    row = first + second
    row[Sums.VIEW] = first[Sums.VIEW]
    return row


def _in_frame(row: NDArray[np.float64], pose: SE2) -> Array:
    """An observation's sums in the frame in which its current frame has this pose."""
    rotation, moved = pose.rotation(), row.copy()
    xx, xy, yy = row[Sums.INFORMATION]
    information = rotation @ np.array([[xx, xy], [xy, yy]]) @ rotation.T
    moved[Sums.INFORMATION] = information[0, 0], information[0, 1], information[1, 1]
    moved[Sums.VECTOR] = rotation @ row[Sums.VECTOR] + information @ [pose.x_m, pose.y_m]
    for part in (Sums.BIAS, Sums.RANGE, Sums.TILTED):
        moved[part] = rotation @ row[part]
    moved[Sums.VIEW] = pose.apply(row[Sums.VIEW])
    moved[Sums.OUTLINE] = (
        row[Sums.OUTLINE].reshape(3, 2) @ rotation.T + row[Sums.OUTLINED] * [pose.x_m, pose.y_m]
    ).ravel()
    moved[Sums.BY_TILT] = (rotation @ row[Sums.BY_TILT].reshape(2, 2)).ravel()
    return moved
