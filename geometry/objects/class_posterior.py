"""Class posterior of an object: overlapping estimates are one object, even if the detected label changes."""

import math
from collections.abc import Mapping
from dataclasses import dataclass

from edgemap.geometry.arrays import Array
from edgemap.geometry.map_object import REPEATED, MapObject
from edgemap.geometry.objects.positions import Positions
from edgemap.geometry.observations.class_extents import extent_m, footprint_m, shares_floor

APART = 0.8  # smallest distance of two objects: share of the smaller one's extent, or shorter side where labels differ


def least_spacing_m(a: MapObject, b: MapObject) -> float:
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


@dataclass(frozen=True, slots=True, eq=False)
class Candidate:
    """Sightings of one label in one place. evidence: count times confidence."""

    id: str
    label: str
    position_m: Array
    width_m: float
    evidence: float


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
    """Which candidates are one object, kept up to date for what changes only.

    members: of each object, by the id of its best candidate: all candidates that are it, the best one first.
    """

    def __init__(self, rule: OverlapRule | None = None) -> None:
        self.rule = rule or OverlapRule()
        self.members: dict[str, list[Candidate]] = {}
        self._candidates: dict[str, Candidate] = {}
        self._positions = Positions[str]()
        self._best: dict[str, str] = {}
        self._changed: set[str] = set()

    def best(self, identity: str) -> str:
        """The id of the object that a candidate is part of."""
        return self._best.get(identity, identity)

    def update(self, candidate: Candidate) -> None:
        """Add a candidate, or change it."""
        self.remove(candidate.id)
        self._candidates[candidate.id] = candidate
        self._positions.set(candidate.id, candidate.position_m)

    def remove(self, identity: str) -> None:
        """Remove a candidate, if it is there."""
        if self._candidates.pop(identity, None) is not None:
            self._positions.remove(identity)
        # What it was better than may be an object, and what it was part of may show it no longer.
        self._changed |= {identity, *(item.id for item in self.members.get(self.best(identity), ()))}

    def within(self, point_m: Array, reach_m: float) -> list[str]:
        """Ids of the candidates within a distance of a point (2,), in a deterministic order."""
        return self._positions.within(point_m, reach_m)

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
        within = self.within(one.position_m, APART * extent_m(one.label, one.width_m))
        return [other for other in within if other != identity and self._overlap(one, self._candidates[other])]

    def _overlap(self, a: Candidate, b: Candidate) -> bool:
        if a.label == b.label:
            less, more = sorted((a.evidence, b.evidence))
            if less >= self.rule.far_less * more:
                return False
            near_m = APART * min(extent_m(item.label, item.width_m) for item in (a, b))
        elif shares_floor(a.label, b.label):
            return False
        else:
            near_m = APART * min(*footprint_m(a.label, a.width_m), *footprint_m(b.label, b.width_m))
        x_m, y_m = a.position_m - b.position_m
        return x_m * x_m + y_m * y_m < near_m * near_m
