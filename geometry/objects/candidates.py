"""Candidates: estimates of what stands where. Overlapping ones are one object, even if the detected label changes."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from edgemap.geometry.arrays import Array
from edgemap.geometry.map_object import REPEATED, MapObject, SightingSums
from edgemap.geometry.objects.footprint import FittedFootprint
from edgemap.geometry.objects.positions import Positions
from edgemap.geometry.observations.class_extents import extent_m, footprint_m, shares_floor
from edgemap.geometry.slam.object_landmarks import Landmark, LandmarkRule

APART = 0.8  # smallest distance of two objects: share of the smaller one's extent, or shorter side where labels differ


def least_spacing_m(a: "MapObject | Candidate", b: "MapObject | Candidate") -> float:
    """Least distance between the centres of two objects of one label."""
    return APART * min(extent_m(item.label, item.width_m) for item in (a, b))


@dataclass(frozen=True, slots=True)
class OverlapRule:
    """When two candidates nearer than `APART` are one object, and what a label states. A table and a seat may be in one
    place, as the seat is pushed under it.
    """

    # Of one label, only where one has less than this share of the other's evidence, as two chairs pushed together are
    # detected about as often.
    far_less: float = 0.5
    # How often a detection has the right label (95 of 105 household boxes on photographs that overlap a true one by
    # 0.6: yolox-nano 46 of 53, picodet-s 49 of 52).
    correct: float = 0.9


@dataclass(slots=True, eq=False)
class Candidate:
    """Landmarks of one label that are one object: the information-weighted mean of their positions, and its covariance.

    presence: probability that it still stands there. footprint: as last fitted. The rest is set by `estimate`.
    position_m: (2,), map frame. covariance_m2: (2, 2), including the errors that all landmarks share. sums, run_sums:
    of all runs, and of this one. saved: the object of an earlier map that is part of this object, if any; the object is
    then shown regardless of its evidence.
    """

    id: str
    label: str
    landmarks: list[Landmark]
    presence: float = 1.0
    footprint: FittedFootprint | None = None
    is_estimated: bool = False
    position_m: Array = field(default_factory=lambda: np.zeros(2))
    covariance_m2: Array = field(default_factory=lambda: np.zeros((2, 2)))
    sums: SightingSums = field(default_factory=SightingSums)
    run_sums: SightingSums = field(default_factory=SightingSums)
    saved: MapObject | None = None

    @property
    def width_m(self) -> float:
        """Mean apparent width."""
        return self.sums.width_m / self.sums.count

    @property
    def evidence(self) -> float:
        """Weight of the sightings times confidence."""
        return self.sums.weight * self.sums.confidence

    def confidence(self, min_count: int) -> float:
        """Probability that an object with these sightings, of this run only, is real: the odds of their mean score to
        the power of their evidence over the evidence that an object needs. Consecutive pictures count as one. At least
        the confidence in an earlier map.
        """
        saved = self.saved.confidence if self.saved else 0.0
        if self.run_sums.count == 0:
            return saved
        odds = self.run_sums.weight / REPEATED / min_count * math.exp(self.run_sums.score_log_odds)
        return max(odds / (1.0 + odds), saved)

    def estimate(self, rule: LandmarkRule) -> None:
        """Updates the estimate from the landmarks."""
        if self.is_estimated:
            return
        landmarks, self.is_estimated, self.sums, self.run_sums = self.landmarks, True, SightingSums(), SightingSums()
        for one in landmarks:
            self.sums.join(one.sums)
            if one.saved is None:
                self.run_sums.join(one.sums)
        self.saved = next((one.saved for one in landmarks if one.saved is not None), None)
        first = min(landmarks, key=lambda one: (one.saved is None, one.sums.first_seen_s))
        since_m2, information, vector, shared = float(np.trace(first.first_m2)) / 2.0, 0.0, 0.0, 0.0
        for one in landmarks:
            weight = np.linalg.inv(one.own_m2 + np.eye(2) * max(one.variance_m2 - since_m2, 0.0))
            information, vector = information + weight, vector + weight @ one.position_m
            shared = shared + one.shared_m2 * (one.sums.count / self.sums.count)
        fused_m2 = np.linalg.inv(information)
        centre_m2 = rule.centre_m2(sum(one.extent_m * one.sums.count for one in landmarks) / self.sums.count)
        self.position_m = fused_m2 @ vector
        self.covariance_m2 = fused_m2 + np.eye(2) * centre_m2 + shared + first.first_m2


def label_posterior(evidence: Mapping[str, float], rule: OverlapRule) -> dict[str, float]:
    """Probability of each detected label of an object, most probable first: Bayes over its sightings' labels.

    evidence: sightings of each label. A detection of a true class shows each other label equally often.
    """
    wrong = math.log((1.0 - rule.correct) / max(len(evidence) - 1, 1) / rule.correct)
    total = sum(evidence.values())
    scores = {label: wrong * (total - count) / REPEATED for label, count in evidence.items()}
    highest = max(scores.values())
    weights = {label: math.exp(score - highest) for label, score in scores.items()}
    order = sorted(weights, key=lambda label: (-weights[label], label))
    return {label: weights[label] / sum(weights.values()) for label in order}


class Overlaps:
    """Which candidates are one object, kept up to date for what changes only. candidates: all of them, by id.

    members: of each object, by the id of its best candidate: all candidates that are it, the best one first. positions:
    of the candidates, by id.
    """

    def __init__(self, candidates: Mapping[str, Candidate], rule: OverlapRule | None = None) -> None:
        self.rule, self._candidates = rule or OverlapRule(), candidates
        self.members: dict[str, list[Candidate]] = {}
        self.positions = Positions[str]()
        self._best: dict[str, str] = {}
        self._changed: set[str] = set()

    def best(self, identity: str) -> str:
        """The id of the object that a candidate is part of."""
        return self._best.get(identity, identity)

    def change(self, identity: str) -> None:
        """A candidate was added, was changed or has left."""
        if identity in self._candidates:
            self.positions.set(identity, self._candidates[identity].position_m)
        else:
            self.positions.remove(identity)
        # Its members may be objects now, and the object that it was part of changes.
        self._changed |= {identity, *(item.id for item in self.members.get(self.best(identity), ()))}

    def settle(self) -> set[str]:
        """Repeats the overlap decision around all changes. Returns the ids of objects that changed or disappeared."""
        near: dict[str, list[str]] = {}  # of all that a change may reach
        while self._changed:
            identity = self._changed.pop()
            near[identity] = self._overlapping(identity)
            self._changed |= {other for other in near[identity] if other not in near}
        touched = near.keys() | {self.best(identity) for identity in near}
        for identity in touched:
            self.members.pop(identity, None)
            self._best.pop(identity, None)
        left = [self._candidates[identity] for identity in near if identity in self._candidates]
        for candidate in sorted(left, key=lambda item: (-item.evidence, item.id)):
            if candidate.id in self._best:
                continue
            self._best[candidate.id], members = candidate.id, [candidate]
            for identity in sorted(near[candidate.id]):
                if identity not in self._best:
                    self._best[identity] = candidate.id
                    members.append(self._candidates[identity])
            self.members[candidate.id] = members
        return touched

    def _overlapping(self, identity: str) -> list[str]:
        """Ids of all that cannot stand where a candidate stands; none where it was removed."""
        if (one := self._candidates.get(identity)) is None:
            return []
        within = self.positions.within(one.position_m, APART * extent_m(one.label, one.width_m))
        return [other for other in within if other != identity and self._overlap(one, self._candidates[other])]

    def _overlap(self, a: Candidate, b: Candidate) -> bool:
        if a.label == b.label:
            less, more = sorted((a.evidence, b.evidence))
            if less >= self.rule.far_less * more:
                return False
            near_m = least_spacing_m(a, b)
        elif shares_floor(a.label, b.label):
            return False
        else:
            near_m = APART * min(*footprint_m(a.label, a.width_m), *footprint_m(b.label, b.width_m))
        x_m, y_m = a.position_m - b.position_m
        return x_m * x_m + y_m * y_m < near_m * near_m
