"""Data association while an object stays in view, too short a time for odometry to drift as far as its twin."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.optimize import linear_sum_assignment

from edgemap.geometry.arrays import Array
from edgemap.geometry.observations.sighting import Sighting
from edgemap.geometry.se2 import SE2


@dataclass(frozen=True, slots=True)
class TrackRule:
    """gap_m: of the odometer without a sighting, after which a track ends. reach_m, gate: of a sighting to its
    track, in metres and as squared Mahalanobis distance. side_m, side_share: standard deviation of an object's centre
    as seen from another side, at least, and as a share of its longer side. per_metre: and per metre since the last
    sighting. averaged: sightings over which a track's position is a mean."""

    gap_m: float = 3.0
    reach_m: float = 1.0
    gate: float = 11.83
    side_m: float = 0.12
    side_share: float = 0.12
    per_metre: float = 0.05
    averaged: int = 10

    def side_m2(self, extent_m: float) -> float:
        """Variance of an object's centre as seen from another side."""
        return self.side_m**2 + (self.side_share * extent_m) ** 2


@dataclass(slots=True, eq=False)
class Track:
    """One object while it stays in view. position_m: (2,) map frame. first, last: keyframes, -1 for one of an earlier
    map, whose prior covariance (2, 2) m^2 is `prior_m2`. seen_at_m: the odometer at the last sighting. beside: tracks
    of its label that were in one frame with it, and so are other objects."""

    number: int
    label: str
    extent_m: float
    position_m: Array
    first: int
    last: int
    seen_at_m: float
    count: int = 0
    prior_m2: Array | None = None
    beside: set[int] = field(default_factory=set)


class Tracker:
    """All tracks by number, in order of appearance."""

    def __init__(self, rule: TrackRule | None = None) -> None:
        self.rule = rule or TrackRule()
        self.tracks: dict[int, Track] = {}
        self._issued = 0
        self._active: list[Track] = []

    def in_view(self, odometer_m: float) -> list[Track]:
        """Those that were seen a short path ago."""
        self._active = [track for track in self._active if odometer_m - track.seen_at_m <= self.rule.gap_m]
        return self._active

    def begin(self, label: str, extent_m: float, position_m: Array, keyframe: int, odometer_m: float) -> Track:
        """A new track."""
        track = Track(self._issued, label, extent_m, position_m, keyframe, keyframe, odometer_m)
        self.tracks[track.number] = track
        self._active.append(track)
        self._issued += 1
        return track

    def follow(self, sightings: Sequence[Sighting], pose: SE2, keyframe: int, odometer_m: float) -> list[Track]:
        """The track of each sighting of one frame, seen from a pose: the nearest in view, one to one, or a new one."""
        rotation, near = pose.rotation(), self.in_view(odometer_m)
        positions = [pose.apply(sighting.position_base_m) for sighting in sightings]
        covariances = [rotation @ sighting.covariance_m2 @ rotation.T for sighting in sightings]
        found: dict[int, Track] = {}
        for label in dict.fromkeys(sighting.label for sighting in sightings):
            rows = [row for row, sighting in enumerate(sightings) if sighting.label == label]
            candidates = [track for track in near if track.label == label]
            found |= self._matched(rows, positions, covariances, candidates, odometer_m)
        tracks = []
        for row, (sighting, position) in enumerate(zip(sightings, positions, strict=True)):
            track = found.get(row) or self.begin(sighting.label, sighting.extent_m, position, keyframe, odometer_m)
            track.count, track.last, track.seen_at_m = track.count + 1, keyframe, odometer_m
            track.position_m = track.position_m + (position - track.position_m) / min(track.count, self.rule.averaged)
            tracks.append(track)
        for track in tracks:
            track.beside.update(t.number for t in tracks if t.label == track.label and t is not track)
        return tracks

    def _matched(
        self,
        rows: list[int],
        positions: list[Array],
        covariances: list[Array],
        candidates: list[Track],
        odometer_m: float,
    ) -> dict[int, Track]:
        if not candidates:
            return {}
        cost = np.full((len(rows), len(candidates) + len(rows)), 1e6)
        for i, row in enumerate(rows):
            cost[i, len(candidates) + i] = self.rule.gate
            for j, track in enumerate(candidates):
                cost[i, j] = self._distance2(positions[row], covariances[row], track, odometer_m)
        chosen = zip(*linear_sum_assignment(cost), strict=True)
        return {rows[i]: candidates[j] for i, j in chosen if j < len(candidates)}

    def _distance2(self, position: Array, covariance: Array, track: Track, odometer_m: float) -> float:
        """Squared Mahalanobis distance; beyond gate or reach so much that a new track costs less."""
        x_m, y_m = position - track.position_m
        if x_m * x_m + y_m * y_m > self.rule.reach_m**2:
            return 1e6
        own = self.rule.side_m2(track.extent_m) + (self.rule.per_metre * (odometer_m - track.seen_at_m)) ** 2
        a, b, d = covariance[0, 0] + own, covariance[0, 1], covariance[1, 1] + own
        distance2 = (d * x_m * x_m - 2.0 * b * x_m * y_m + a * y_m * y_m) / (a * d - b * b)
        return float(distance2) if distance2 <= self.rule.gate else 1e6
