"""When a sighting belongs to an object and two objects are one: fused estimates, distances under both covariances."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from edgemap.geometry.floor_map import MapObject, SightingSums
from edgemap.geometry.shapes import extent_m
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
    and as a share of the footprint's longer side. min_count, min_confidence, max_sigma_m: what an object needs to show
    on the map; the last is the largest standard deviation of its place, without what it shares with its neighbours.
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
    max_sigma_m: float = 0.4
    forget_after: int = 300


class Estimate:
    """A fused position: information-weighted mean of sightings, plus what they all share.

    position_m: (2,) in the map frame. saved: it comes from an earlier map, and shows whatever the evidence.
    """

    def __init__(self, placed: PlacedSighting) -> None:
        self.information, self.vector = np.zeros((2, 2)), np.zeros(2)
        self.shared_sum, self.weight = np.zeros((2, 2)), 0.0
        self.first_pose = placed.pose_covariance
        self.first_pose_m2 = placed.from_pose(placed.pose_covariance)
        self.extent_m = placed.sighting.extent_m
        self.sums = SightingSums()
        self.saved = False
        self.add(placed)

    @classmethod
    def of_saved(cls, item: MapObject, rule: AssociationRule) -> Estimate:
        """An object of an earlier map, ready for more sightings.

        A map does not say which part of its uncertainty its objects share: all of it but the systematic one counts as
        this object's own, and the new drive's pose as independent of it.
        """
        estimate = cls.__new__(cls)
        estimate.saved = True
        estimate.sums = SightingSums.of_saved(item)
        estimate.extent_m = extent_m(item.label, item.width_m)
        systematic_m = max(rule.systematic_m, rule.systematic_extent_share * estimate.extent_m)
        spread = positive(item.covariance_m2 - np.eye(2) * systematic_m**2, least=1e-4)
        estimate.information = _inverse(spread / min(rule.correlated, max(float(item.count), 1.0)))
        estimate.vector = estimate.information @ item.position_m
        estimate.shared_sum, estimate.weight = np.zeros((2, 2)), float(np.trace(estimate.information))
        estimate.first_pose, estimate.first_pose_m2 = np.zeros((3, 3)), np.zeros((2, 2))
        estimate._settle()
        return estimate

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
        self.saved |= other.saved
        self._settle()

    def _settle(self) -> None:
        self._spread_m2 = _inverse(self.information)
        self.position_m = self._spread_m2 @ self.vector

    def sighting_covariance(self, placed: PlacedSighting) -> Array:
        """(2, 2) m^2: pixels, and the pose's uncertainty since this object was first seen."""
        return placed.covariance_m2 + placed.from_pose(positive(placed.pose_covariance - self.first_pose))

    def own_covariance(self, rule: AssociationRule) -> Array:
        """(2, 2) m^2 of what this object does not share with its neighbours."""
        correlated = min(rule.correlated, float(self.sums.count))
        systematic_m = max(rule.systematic_m, rule.systematic_extent_share * self.extent_m)
        return self._spread_m2 * correlated + np.eye(2) * systematic_m**2

    def shows(self, rule: AssociationRule) -> bool:
        """Whether there is enough evidence to put it on the map."""
        return self.saved or (self.sums.count >= rule.min_count and self.sums.confidence >= rule.min_confidence)

    def covariance(self, rule: AssociationRule) -> Array:
        """(2, 2) m^2 in the map frame: own part, plus mount and first pose, which no number of sightings shrinks."""
        return self.own_covariance(rule) + self.shared_sum / self.weight + self.first_pose_m2


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


def positive(matrix: Array, least: float = 0.0) -> Array:
    """The nearest symmetric matrix with no eigenvalue below `least`."""
    if least == 0.0 and not matrix.any():
        return matrix
    values, vectors = np.linalg.eigh((matrix + matrix.T) / 2.0)
    return (vectors * np.maximum(values, least)) @ vectors.T
