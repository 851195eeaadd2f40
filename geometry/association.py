"""The default clustering: each sighting goes to the object that it fits best, under both covariances.

Two boxes of one frame never become one object, so chairs that stand closer than the paper's 1 m stay apart. Objects
that turn out to be one (close, and never seen side by side) merge, and the older id stays.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from edgemap.geometry.floor_map import MapObject, SightingSums, id_order
from edgemap.geometry.sighting import PlacedSighting

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class AssociationRule:
    """When sightings and objects are the same thing.

    gate: squared Mahalanobis distance, 9.21 holds 99 % of true pairs in the plane. max_distance_m: never farther than
    this. merge_gate: the same for two objects, no farther apart than merge_distance_m or merge_extent_share of their
    class's footprint, whichever is more; objects seen side by side in one frame never merge. correlated: neighbouring
    frames repeat each other's error, so this many sightings weigh as one. systematic_m, systematic_extent_share:
    standard deviation of what no number of sightings takes away (a box's lower edge is not the footprint), at least,
    and as a share of the footprint's longer side. min_count, min_confidence: what an object needs to show on the map.
    forget_after: frames after which one that does not is dropped.
    """

    gate: float = 9.21
    max_distance_m: float = 1.5
    merge_gate: float = 5.99
    merge_distance_m: float = 0.6
    merge_extent_share: float = 0.5
    correlated: float = 4.0
    systematic_m: float = 0.08
    systematic_extent_share: float = 0.15
    min_count: int = 3
    min_confidence: float = 0.6
    forget_after: int = 300


class Estimate:
    """A fused position: information-weighted mean of sightings, plus what they all share.

    position_m: (2,) in the map frame.
    """

    def __init__(self, placed: PlacedSighting) -> None:
        self.information, self.vector = np.zeros((2, 2)), np.zeros(2)
        self.shared_sum, self.weight = np.zeros((2, 2)), 0.0
        self.first_pose = placed.pose_covariance
        self.first_pose_m2 = placed.from_pose(placed.pose_covariance)
        self.extent_m = placed.sighting.extent_m
        self.sums = SightingSums()
        self.add(placed)

    def add(self, placed: PlacedSighting) -> None:
        """Fuse one more sighting."""
        information = _inverse(self.sighting_covariance(placed))
        self.information += information
        self.vector += information @ placed.position_map_m
        trace = float(np.trace(information))
        self.shared_sum += trace * placed.shared_m2
        self.weight += trace
        self.sums.add(placed)
        self._settle()

    def join(self, other: Estimate) -> None:
        """Fuse another object's sightings; the earlier one's first pose stays."""
        if other.sums.first_seen_s < self.sums.first_seen_s:
            self.first_pose, self.first_pose_m2 = other.first_pose, other.first_pose_m2
        self.information += other.information
        self.vector += other.vector
        self.shared_sum += other.shared_sum
        self.weight += other.weight
        self.sums.join(other.sums)
        self._settle()

    def _settle(self) -> None:
        self._spread_m2 = _inverse(self.information)
        self.position_m = self._spread_m2 @ self.vector

    def sighting_covariance(self, placed: PlacedSighting) -> Array:
        """(2, 2) m^2: pixels, and the pose's uncertainty since this object was first seen."""
        return placed.covariance_m2 + placed.from_pose(_positive(placed.pose_covariance - self.first_pose))

    def own_covariance(self, rule: AssociationRule) -> Array:
        """(2, 2) m^2 of what this object does not share with its neighbours."""
        correlated = min(rule.correlated, float(self.sums.count))
        systematic_m = max(rule.systematic_m, rule.systematic_extent_share * self.extent_m)
        return self._spread_m2 * correlated + np.eye(2) * systematic_m**2

    def shows(self, rule: AssociationRule) -> bool:
        """Whether there is enough evidence to put it on the map."""
        return self.sums.count >= rule.min_count and self.sums.confidence >= rule.min_confidence

    def covariance(self, rule: AssociationRule) -> Array:
        """(2, 2) m^2 in the map frame: own part, plus mount and first pose, which no number of sightings shrinks."""
        return self.own_covariance(rule) + self.shared_sum / self.weight + self.first_pose_m2


@dataclass(slots=True)
class _Object:
    """together: ids of objects seen beside it in one frame. updated: number of the last frame that saw it."""

    id: str
    estimate: Estimate
    updated: int
    together: set[str] = field(default_factory=set)
    shown: MapObject | None = None


class _Class:
    """The objects of one label, with their positions side by side so that few of them need a closer look."""

    def __init__(self) -> None:
        self.objects: list[_Object] = []
        self._positions_m = np.zeros((0, 2))

    def near(self, position_m: Array, reach_m: float) -> list[int]:
        """Rows of the objects within reach of a position (2,)."""
        offsets = self._positions_m - position_m
        return np.flatnonzero((offsets**2).sum(axis=1) <= reach_m**2).tolist()

    def append(self, item: _Object) -> None:
        """Add an object."""
        self.objects.append(item)
        self._positions_m = np.vstack([self._positions_m, item.estimate.position_m])

    def moved(self, row: int) -> None:
        """Take note that an object's estimate has changed."""
        self._positions_m[row] = self.objects[row].estimate.position_m
        self.objects[row].shown = None

    def keep(self, wanted: list[bool]) -> None:
        """Drop the objects that are not wanted."""
        if not all(wanted):
            self.objects = [item for item, stays in zip(self.objects, wanted, strict=True) if stays]
            self._positions_m = self._positions_m[np.array(wanted, dtype=bool)]


class FloorMap:
    """Objects by association, fed frame by frame; deterministic ids such as `chair-3` in order of appearance."""

    def __init__(self, rule: AssociationRule | None = None) -> None:
        self.rule = rule or AssociationRule()
        self._classes: dict[str, _Class] = {}
        self._issued: Counter[str] = Counter()
        self._frames = 0
        self.merged: dict[str, str] = {}

    def update(self, sightings: list[PlacedSighting]) -> list[str]:
        """Take in all sightings of one frame; the id of each one's object."""
        self._frames += 1
        ids = [""] * len(sightings)
        for label in dict.fromkeys(placed.label for placed in sightings):
            rows = [row for row, placed in enumerate(sightings) if placed.label == label]
            for row, identity in zip(rows, self._update_label(label, [sightings[r] for r in rows]), strict=True):
                ids[row] = identity
        if self._frames % self.rule.forget_after == 0:
            self._forget()
        return ids

    def objects(self) -> list[MapObject]:
        """Objects with enough evidence, ordered by id."""
        found = []
        for label, kind in self._classes.items():
            for item in kind.objects:
                if item.shown is None and item.estimate.shows(self.rule):
                    estimate = item.estimate
                    covariance = estimate.covariance(self.rule)
                    item.shown = estimate.sums.as_object(item.id, label, estimate.position_m, covariance)
                if item.shown is not None:
                    found.append(item.shown)
        return sorted(found, key=lambda item: id_order(item.id))

    def _update_label(self, label: str, sightings: list[PlacedSighting]) -> list[str]:
        kind = self._classes.setdefault(label, _Class())
        seen: list[_Object] = []
        for placed, row in zip(sightings, self._match(sightings, kind), strict=True):
            if row is None:
                self._issued[label] += 1
                item = _Object(f"{label}-{self._issued[label]}", Estimate(placed), self._frames)
                kind.append(item)
            else:
                item = kind.objects[row]
                item.estimate.add(placed)
                item.updated = self._frames
                kind.moved(row)
            seen.append(item)
        for item in seen:
            item.together.update(other.id for other in seen if other is not item)
        renamed = self._merge(kind, seen)
        return [renamed.get(item.id, item.id) for item in seen]

    def _match(self, sightings: list[PlacedSighting], kind: _Class) -> list[int | None]:
        """For each sighting the row of the object it belongs to, or None."""
        near = {row for placed in sightings for row in kind.near(placed.position_map_m, self.rule.max_distance_m)}
        rows = sorted(near)
        matches = assign(sightings, [kind.objects[row].estimate for row in rows], self.rule)
        return [None if match is None else rows[match] for match in matches]

    def _merge(self, kind: _Class, seen: list[_Object]) -> dict[str, str]:
        """Join every object seen now with others of its label that are the same thing; old id to new id."""
        renamed: dict[str, str] = {}
        gone: set[str] = set()
        for item in seen:
            reach_m = max(self.rule.merge_distance_m, self.rule.merge_extent_share * item.estimate.extent_m)
            for row in kind.near(item.estimate.position_m, reach_m):
                other = kind.objects[row]
                if other is item or item.id in gone or other.id in gone or not self._same(item, other):
                    continue
                older, younger = sorted((item, other), key=lambda o: id_order(o.id))
                older.estimate.join(younger.estimate)
                older.together |= younger.together
                older.updated = max(older.updated, younger.updated)
                gone.add(younger.id)
                renamed[younger.id] = older.id
                kind.moved(kind.objects.index(older))
        if renamed:
            kind.keep([item.id not in gone for item in kind.objects])
            for old, new in list(renamed.items()):
                while new in renamed:
                    new = renamed[new]
                renamed[old] = new
            self.merged = {old: renamed.get(new, new) for old, new in self.merged.items()} | renamed
            for item in kind.objects:
                item.together = {renamed.get(identity, identity) for identity in item.together} - {item.id}
        return renamed

    def _same(self, a: _Object, b: _Object) -> bool:
        beside = b.id in a.together or a.id in b.together
        return not beside and may_merge(a.estimate, b.estimate, self.rule)

    def _forget(self) -> None:
        """Drop what never gathered enough evidence and has not been seen for long, so that a long drive stays quick."""
        for kind in self._classes.values():
            kind.keep(
                [
                    item.estimate.shows(self.rule) or self._frames - item.updated < self.rule.forget_after
                    for item in kind.objects
                ]
            )


def assign(
    sightings: Sequence[PlacedSighting], estimates: Sequence[Estimate], rule: AssociationRule
) -> list[int | None]:
    """For each sighting of one frame the estimate it fits, or None: least total squared Mahalanobis distance, one to
    one, within the gate and the greatest distance."""
    if not estimates:
        return [None] * len(sightings)
    cost = np.full((len(sightings), len(estimates) + len(sightings)), 1e6)
    for i, placed in enumerate(sightings):
        cost[i, len(estimates) + i] = rule.gate
        for j, estimate in enumerate(estimates):
            difference = placed.position_map_m - estimate.position_m
            if difference @ difference <= rule.max_distance_m**2:
                spread = estimate.sighting_covariance(placed) + estimate.own_covariance(rule)
                distance = mahalanobis2(difference, spread)
                if distance <= rule.gate:
                    cost[i, j] = distance
    _, columns = linear_sum_assignment(cost)
    return [int(column) if column < len(estimates) else None for column in columns]


def may_merge(a: Estimate, b: Estimate, rule: AssociationRule) -> bool:
    """Whether two estimates lie close enough, in metres and under both covariances, to be one object."""
    difference = a.position_m - b.position_m
    reach_m = max(rule.merge_distance_m, rule.merge_extent_share * min(a.extent_m, b.extent_m))
    if difference @ difference > reach_m**2:
        return False
    spread = a.own_covariance(rule) + b.own_covariance(rule)
    return mahalanobis2(difference, spread) <= rule.merge_gate


def mahalanobis2(difference: Array, covariance: Array) -> float:
    """Squared Mahalanobis distance of a (2,) difference under a (2, 2) covariance."""
    return float(difference @ _inverse(covariance) @ difference)


def _inverse(matrix: Array) -> Array:
    (a, b), (c, d) = matrix
    return np.array([[d, -b], [-c, a]]) / (a * d - b * c)


def _positive(matrix: Array) -> Array:
    """The nearest positive semidefinite matrix: negative eigenvalues become zero."""
    if not matrix.any():
        return matrix
    values, vectors = np.linalg.eigh((matrix + matrix.T) / 2.0)
    return (vectors * np.maximum(values, 0.0)) @ vectors.T
