"""Sightings followed while a thing stays in view, too short a time for odometry to drift so far as to its twin."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from edgemap.geometry.observations.sighting import Sighting
from edgemap.geometry.se2 import SE2

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class TrackRule:
    """gap_m: of the odometer without a sighting, after which a thing is seen anew. reach_m, gate: of a sighting to its
    track, in metres and as squared Mahalanobis distance. side_m, side_share: standard deviation of a thing's middle as
    seen from another side, at least, and as a share of its longer side. per_metre: and per metre since the last
    sighting. settled: sightings over which a track's place is a mean."""

    gap_m: float = 3.0
    reach_m: float = 1.0
    gate: float = 11.83
    side_m: float = 0.12
    side_share: float = 0.12
    per_metre: float = 0.05
    settled: int = 10

    def side_m2(self, extent_m: float) -> float:
        """Variance of a thing's middle as seen from another side."""
        return self.side_m**2 + (self.side_share * extent_m) ** 2


@dataclass(slots=True, eq=False)
class Track:
    """One thing while it stays in view. position_m: (2,) map frame. first, last: keyframes, -1 for one of an earlier
    map. seen_at_m: the odometer at the last sighting."""

    number: int
    label: str
    extent_m: float
    position_m: Array
    first: int
    last: int
    seen_at_m: float
    count: int = 0


class Tracker:
    """All tracks by number, in order of appearance."""

    def __init__(self, rule: TrackRule | None = None) -> None:
        self.rule = rule or TrackRule()
        self.tracks: dict[int, Track] = {}
        self._issued = 0

    def in_view(self, odometer_m: float) -> list[Track]:
        """Those that were seen a short way ago."""
        return [track for track in self.tracks.values() if odometer_m - track.seen_at_m <= self.rule.gap_m]

    def begin(self, label: str, extent_m: float, position_m: Array, keyframe: int, odometer_m: float) -> Track:
        """A new track."""
        track = Track(self._issued, label, extent_m, position_m, keyframe, keyframe, odometer_m)
        self.tracks[track.number] = track
        self._issued += 1
        return track

    def follow(self, sightings: Sequence[Sighting], pose: SE2, keyframe: int, odometer_m: float) -> list[Track]:
        """The track of each sighting of one frame, seen from a pose: the nearest in view, one to one, or a new one."""
        rotation, near = pose.rotation(), self.in_view(odometer_m)
        places = [pose.apply(sighting.position_base_m) for sighting in sightings]
        spreads = [rotation @ sighting.covariance_m2 @ rotation.T for sighting in sightings]
        found: dict[int, Track] = {}
        for label in dict.fromkeys(sighting.label for sighting in sightings):
            rows = [row for row, sighting in enumerate(sightings) if sighting.label == label]
            known = [track for track in near if track.label == label]
            found |= self._matched(rows, places, spreads, known, odometer_m)
        tracks = []
        for row, (sighting, place) in enumerate(zip(sightings, places, strict=True)):
            track = found.get(row) or self.begin(sighting.label, sighting.extent_m, place, keyframe, odometer_m)
            track.count, track.last, track.seen_at_m = track.count + 1, keyframe, odometer_m
            track.position_m = track.position_m + (place - track.position_m) / min(track.count, self.rule.settled)
            tracks.append(track)
        return tracks

    def _matched(
        self, rows: list[int], places: list[Array], spreads: list[Array], known: list[Track], odometer_m: float
    ) -> dict[int, Track]:
        if not known:
            return {}
        cost = np.full((len(rows), len(known) + len(rows)), 1e6)
        for i, row in enumerate(rows):
            cost[i, len(known) + i] = self.rule.gate
            for j, track in enumerate(known):
                cost[i, j] = self._distance2(places[row], spreads[row], track, odometer_m)
        chosen = zip(*linear_sum_assignment(cost), strict=True)
        return {rows[i]: known[j] for i, j in chosen if j < len(known)}

    def _distance2(self, place: Array, spread: Array, track: Track, odometer_m: float) -> float:
        """Squared Mahalanobis distance; beyond gate or reach so much that a new track costs less."""
        x_m, y_m = place - track.position_m
        if x_m * x_m + y_m * y_m > self.rule.reach_m**2:
            return 1e6
        own = self.rule.side_m2(track.extent_m) + (self.rule.per_metre * (odometer_m - track.seen_at_m)) ** 2
        a, b, d = spread[0, 0] + own, spread[0, 1], spread[1, 1] + own
        distance2 = (d * x_m * x_m - 2.0 * b * x_m * y_m + a * y_m * y_m) / (a * d - b * b)
        return float(distance2) if distance2 <= self.rule.gate else 1e6
