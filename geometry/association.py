"""The default clustering: each sighting goes to the object that it fits best, under both covariances.

Two boxes of one frame never become one object, so chairs that stand closer than the paper's 1 m stay apart. Objects
that turn out to be one (close, and never seen side by side) merge, and the older id stays.
"""

from __future__ import annotations

from collections import Counter
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
    class's footprint, whichever is more. together_share: objects seen side by side in more than this share of the rarer
    one's frames never merge. correlated: neighbouring frames repeat each other's error, so this many sightings weigh as
    one. systematic_m, systematic_extent_share: standard deviation of what no number of sightings takes away (a box's
    lower edge is not the footprint), at least, and as a share of the footprint's longer side. min_count,
    min_confidence: what an object needs to show on the map.
    """

    gate: float = 9.21
    max_distance_m: float = 1.5
    merge_gate: float = 5.99
    merge_distance_m: float = 0.6
    merge_extent_share: float = 0.5
    together_share: float = 0.1
    correlated: float = 4.0
    systematic_m: float = 0.08
    systematic_extent_share: float = 0.15
    min_count: int = 3
    min_confidence: float = 0.6


class Estimate:
    """A fused position: information-weighted mean of sightings, plus what they all share."""

    __slots__ = ("extent_m", "first_pose", "first_pose_m2", "information", "shared_sum", "sums", "vector", "weight")

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

    def join(self, other: Estimate) -> None:
        """Fuse another object's sightings; the earlier one's first pose stays."""
        if other.sums.first_seen_s < self.sums.first_seen_s:
            self.first_pose, self.first_pose_m2 = other.first_pose, other.first_pose_m2
        self.information += other.information
        self.vector += other.vector
        self.shared_sum += other.shared_sum
        self.weight += other.weight
        self.sums.join(other.sums)

    def sighting_covariance(self, placed: PlacedSighting) -> Array:
        """(2, 2) m^2: pixels, and the pose's uncertainty since this object was first seen."""
        return placed.covariance_m2 + placed.from_pose(_positive(placed.pose_covariance - self.first_pose))

    @property
    def position_m(self) -> Array:
        """(2,) in the map frame."""
        return _inverse(self.information) @ self.vector

    def own_covariance(self, rule: AssociationRule) -> Array:
        """(2, 2) m^2 of what this object does not share with its neighbours."""
        correlated = min(rule.correlated, float(self.sums.count))
        systematic_m = max(rule.systematic_m, rule.systematic_extent_share * self.extent_m)
        return _inverse(self.information) * correlated + np.eye(2) * systematic_m**2

    def shows(self, rule: AssociationRule) -> bool:
        """Whether there is enough evidence to put it on the map."""
        return self.sums.count >= rule.min_count and self.sums.confidence >= rule.min_confidence

    def covariance(self, rule: AssociationRule) -> Array:
        """(2, 2) m^2 in the map frame: own part, plus mount and first pose, which no number of sightings shrinks."""
        return self.own_covariance(rule) + self.shared_sum / self.weight + self.first_pose_m2


@dataclass(slots=True)
class _Object:
    id: str
    estimate: Estimate
    together: Counter[str] = field(default_factory=Counter)


class FloorMap:
    """Objects by association, fed frame by frame; deterministic ids such as `chair-3` in order of appearance."""

    def __init__(self, rule: AssociationRule | None = None) -> None:
        self.rule = rule or AssociationRule()
        self._objects: dict[str, list[_Object]] = {}
        self._issued: Counter[str] = Counter()
        self.merged: dict[str, str] = {}

    def update(self, sightings: list[PlacedSighting]) -> list[str]:
        """Take in all sightings of one frame; the id of each one's object. Bad order of frames does no harm."""
        ids = [""] * len(sightings)
        for label in dict.fromkeys(placed.label for placed in sightings):
            rows = [row for row, placed in enumerate(sightings) if placed.label == label]
            for row, identity in zip(rows, self._update_label(label, [sightings[r] for r in rows]), strict=True):
                ids[row] = identity
        return ids

    def objects(self) -> list[MapObject]:
        """Objects with enough evidence, ordered by id."""
        found = [
            item.estimate.sums.as_object(item.id, label, item.estimate.position_m, item.estimate.covariance(self.rule))
            for label, items in self._objects.items()
            for item in items
            if item.estimate.shows(self.rule)
        ]
        return sorted(found, key=lambda item: id_order(item.id))

    def _update_label(self, label: str, sightings: list[PlacedSighting]) -> list[str]:
        objects = self._objects.setdefault(label, [])
        matches = self._match(sightings, objects)
        seen: list[_Object] = []
        for placed, match in zip(sightings, matches, strict=True):
            if match is None:
                self._issued[label] += 1
                item = _Object(f"{label}-{self._issued[label]}", Estimate(placed))
                objects.append(item)
            else:
                item = objects[match]
                item.estimate.add(placed)
            seen.append(item)
        for item in seen:
            item.together.update(other.id for other in seen if other is not item)
        renamed = self._merge(label, seen)
        return [renamed.get(item.id, item.id) for item in seen]

    def _match(self, sightings: list[PlacedSighting], objects: list[_Object]) -> list[int | None]:
        """For each sighting the object it belongs to, or None: least total squared Mahalanobis distance, one to one."""
        if not objects:
            return [None] * len(sightings)
        cost = np.full((len(sightings), len(objects) + len(sightings)), 1e6)
        for i, placed in enumerate(sightings):
            cost[i, len(objects) + i] = self.rule.gate
            for j, item in enumerate(objects):
                difference = placed.position_map_m - item.estimate.position_m
                if difference @ difference > self.rule.max_distance_m**2:
                    continue
                spread = item.estimate.sighting_covariance(placed) + item.estimate.own_covariance(self.rule)
                distance = mahalanobis2(difference, spread)
                if distance <= self.rule.gate:
                    cost[i, j] = distance
        _, columns = linear_sum_assignment(cost)
        return [int(column) if column < len(objects) else None for column in columns]

    def _merge(self, label: str, seen: list[_Object]) -> dict[str, str]:
        """Join every object seen now with others of its label that are the same thing; old id to new id."""
        objects, renamed = self._objects[label], {}
        for item in seen:
            for other in list(objects):
                if other is item or item not in objects or other not in objects:
                    continue
                if self._same(item, other):
                    older, younger = sorted((item, other), key=lambda o: id_order(o.id))
                    older.estimate.join(younger.estimate)
                    older.together.update(younger.together)
                    objects.remove(younger)
                    renamed[younger.id] = older.id
        for old, new in list(renamed.items()):
            while new in renamed:
                new = renamed[new]
            renamed[old] = new
        self.merged = {old: renamed.get(new, new) for old, new in self.merged.items()} | renamed
        for item in objects if renamed else ():
            for old, new in renamed.items():
                if old in item.together:
                    item.together[new] += item.together.pop(old)
        return renamed

    def _same(self, a: _Object, b: _Object) -> bool:
        rarer = min(a.estimate.sums.count, b.estimate.sums.count)
        if a.together[b.id] > self.rule.together_share * rarer:
            return False
        return may_merge(a.estimate, b.estimate, self.rule)


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
