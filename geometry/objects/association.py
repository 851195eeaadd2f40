"""When sightings are one object, and what that one is: its position, covariance and size from its pools."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from edgemap.geometry.arrays import Array
from edgemap.geometry.objects.class_posterior import OverlapRule
from edgemap.geometry.objects.map_object import MapObject, SightingSums
from edgemap.geometry.objects.observation_pool import ObservationPool, mean_variance


@dataclass(frozen=True, slots=True)
class AssociationRule:
    """When sightings are the same object.

    gate: squared Mahalanobis distance up to which two pools or clusters join; 13.82 holds 99.9 % of true pairs in the
    plane. max_distance_m: never farther than this. correlated: neighbouring frames repeat each other's error, so this
    many sightings weigh as one. systematic_m, systematic_extent_share: standard deviation of what no number of
    sightings takes away (a box's lower edge is not the footprint), at least, and as a share of the footprint's longer
    side. min_count (of what its sightings count, see FloorRule), min_confidence: what an object needs to show
    on the map (chosen on simulated homes). forget_after: frames after which one that does not is dropped.
    maximum_pools: of one object, the least recent ones of more are joined. budget: pools that moved, or were only seen
    better, associated again in one frame. still_m: what moves by less needs no association; grown: nor what was not yet
    seen so many times as often as when it was associated last.
    real_log_odds, real_slope, real_score: that an object is real, after one full sighting with a mean score of 0.5, per
    e-fold of full sightings, and per unit of the mean score's log-odds, as a box's score is about its precision on
    photographs (logistic regression on the 199 objects that two detectors map in seven tuning drives).
    """

    gate: float = 13.82
    max_distance_m: float = 1.5
    correlated: float = 4.0
    systematic_m: float = 0.08
    systematic_extent_share: float = 0.15
    min_count: int = 4
    min_confidence: float = 0.6
    forget_after: int = 3000
    maximum_pools: int = 8
    budget: int = 8
    still_m: float = 0.02
    grown: float = 1.25
    real_log_odds: float = -3.05
    real_slope: float = 0.98
    real_score: float = 1.5
    overlap: OverlapRule = field(default_factory=OverlapRule)

    def systematic_of(self, extent_m: float) -> float:
        """Standard deviation, metres, that no number of sightings takes away from an object of this size."""
        return max(self.systematic_m, self.systematic_extent_share * extent_m)


class Estimate:
    """One object, fused from its pools: information-weighted mean of their places, plus what they all share.

    position_m: (2,) in the map frame. saved: the earlier map's object that is part of it, which shows whatever the
    evidence.
    """

    def __init__(self, pools: Sequence[ObservationPool], rule: AssociationRule) -> None:
        self.sums = SightingSums()
        for pool in pools:
            self.sums.join(pool.sums)
        self._pools, self._rule = pools, rule
        self.saved = next((pool.saved for pool in pools if pool.saved is not None), None)
        first = min(pools, key=lambda pool: (pool.saved is None, pool.sums.first_seen_s))
        self._first_m2 = first.first_m2
        first_m2_mean = mean_variance(first.first_m2)
        xx, xy, yy = np.array([pool.information for pool in pools]).T
        vx, vy = np.array([pool.vector for pool in pools]).T
        determinant = xx * yy - xy * xy
        x_m, y_m = (yy * vx - xy * vy) / determinant, (xx * vy - xy * vx) / determinant
        scale = np.minimum([float(pool.sums.count) for pool in pools], rule.correlated) / determinant
        drift_m2 = np.maximum(np.array([pool.variance_m2 for pool in pools]) - first_m2_mean, 0.0)
        a, b, c = yy * scale + drift_m2, -xy * scale, xx * scale + drift_m2
        determinant = a * c - b * b
        xx, xy, yy = c / determinant, -b / determinant, a / determinant
        information = np.array([[xx.sum(), xy.sum()], [xy.sum(), yy.sum()]])
        self._own_m2 = np.linalg.inv(information)
        self.position_m = self._own_m2 @ [(xx * x_m + xy * y_m).sum(), (xy * x_m + yy * y_m).sum()]

    def shows(self, others: Sequence[SightingSums] = ()) -> bool:
        """Whether there is enough evidence to put it on the map. others: sightings of it under other labels."""
        weight = self.sums.weight + sum(sums.weight for sums in others)
        confidence = -math.expm1(self.sums.miss + sum(sums.miss for sums in others))
        enough = weight >= self._rule.min_count and confidence >= self._rule.min_confidence
        return self.saved is not None or enough

    def covariance(self) -> Array:
        """(2, 2) m^2 in the map frame: own part, plus mount and first pose, which no number of sightings shrinks."""
        extent_m = sum(pool.extent_m * pool.sums.count for pool in self._pools) / self.sums.count
        shared = sum((pool.shared for pool in self._pools), np.zeros((2, 2))) / sum(p.weight for p in self._pools)
        own = self._own_m2 + np.eye(2) * self._rule.systematic_of(extent_m) ** 2
        return own + shared + self._first_m2

    def as_object(self, identity: str, label: str) -> MapObject:
        """The object as a map shows it; its confidence is the probability that such an object is real, and no less than
        what an earlier map says."""
        plain = self.sums.as_object(identity, label, self.position_m, self.covariance())
        return replace(plain, confidence=max(self._real(), self.saved.confidence if self.saved else 0.0))

    def _real(self) -> float:
        """Probability that an object with such sightings of this run is real."""
        rule, sums = self._rule, SightingSums()
        for pool in self._pools:
            if pool.saved is None:
                sums.join(pool.sums)
        if sums.count == 0:
            return 0.0
        log_odds = rule.real_log_odds + rule.real_slope * math.log(max(sums.weight, 1.0))
        return 1.0 / (1.0 + math.exp(-log_odds - rule.real_score * sums.score_log_odds))
