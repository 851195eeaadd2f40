"""A drive as a graph of poses and of things that stand still: seen again, they put the whole way right."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from edgemap.geometry.objects.map_object import MapObject
from edgemap.geometry.objects.observation_pool import ObjectShift
from edgemap.geometry.observations.sighting import Sighting
from edgemap.geometry.se2 import SE2
from edgemap.geometry.slam.keyframes import KeyframeRule, KeyframeTrajectory, TrajectoryCorrection, points_from
from edgemap.geometry.slam.least_squares import LandmarkPriors, ObservationFactors, Solution, inverse, solve
from edgemap.geometry.slam.loop_hypotheses import LoopHypothesisRule, Pairing, certain_pairings
from edgemap.geometry.slam.tracks import Track, Tracker, TrackRule

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class GraphRule:
    """How a drive becomes a graph. look_m: standard deviation of what a thing looks like from one keyframe, beside its
    sightings' own. least: sightings that make a thing a landmark. most: landmarks kept. every: keyframes between two
    looks for things seen before. misfit: mean squared residual of a thing's looks above which a pairing is taken back.
    """

    look_m: float = 0.15
    least: int = 5
    most: int = 150
    every: int = 4
    misfit: float = 4.0
    way: KeyframeRule = field(default_factory=KeyframeRule)
    track: TrackRule = field(default_factory=TrackRule)
    revisit: LoopHypothesisRule = field(default_factory=LoopHypothesisRule)


@dataclass(frozen=True, slots=True, eq=False)
class _Observation:
    """A track seen from a keyframe: place_m (2,) and information (2, 2) in the keyframe's frame."""

    keyframe: int
    track: int
    place_m: Array
    information: Array


@dataclass(frozen=True, slots=True, eq=False)
class _Solved:
    """row: of each landmark, by group. misfit: mean squared residual of each track's looks."""

    solution: Solution
    row: dict[int, int]
    misfit: dict[int, float]


@dataclass(frozen=True, slots=True, eq=False)
class LoopClosure:
    """What things seen again say: how the past moved, the pose's covariance (3, 3) now, and where each thing lies."""

    past: TrajectoryCorrection
    covariance: Array
    moves: dict[int, ObjectShift]


class DriveGraph:
    """Fed every frame's motion and sightings. Tracks that are one thing form a group, which is one landmark.

    links: pairings of a track with a thing seen before, so far. What is due when depends on way and turn only.
    """

    def __init__(self, rule: GraphRule | None = None) -> None:
        self.rule = rule or GraphRule()
        self.way, self.tracker = KeyframeTrajectory(self.rule.way), Tracker(self.rule.track)
        self.links = 0
        self._group: dict[int, int] = {}
        self._open: dict[int, list[tuple[Array, Array]]] = {}
        self._looks: list[_Observation] = []
        self._known: dict[int, tuple[Array, Array]] = {}
        self._refused: set[tuple[int, int]] = set()

    def remember(self, objects: Sequence[MapObject]) -> None:
        """Things of an earlier map, in the frame that the way is in: seen again, they put it right."""
        for item in objects:
            track = self.tracker.begin(item.label, item.width_m, item.position_m, -1, -np.inf)
            track.count = max(item.count, self.rule.least)
            self._group[track.number] = track.number
            self._known[track.number] = item.position_m, inverse(item.covariance_m2)

    def advance(self, motion: SE2, covariance: Array, stamp_s: float) -> bool:
        """Move on by one frame; whether this is when to look for things seen before."""
        if not self.way.is_due(motion, covariance):
            return False
        self._close_looks()
        self.way.keep(stamp_s)
        if len(self.way) > self.rule.way.most:
            self._thin_out()
        due = len(self.way) % self.rule.every == 0
        if due:
            self._forget()
        return due

    def look(self, sightings: Sequence[Sighting]) -> list[Track]:
        """Take in one frame's sightings, from where the last `advance` or `revisit` came to; the track of each."""
        way = self.way
        tracks = self.tracker.follow(sightings, way.pose, len(way) - 1, way.odometer_m)
        rotation = way.since.rotation()
        for track, sighting in zip(tracks, sightings, strict=True):
            self._group.setdefault(track.number, track.number)
            spread = rotation @ (sighting.covariance_m2 + sighting.shared_m2) @ rotation.T
            place = way.since.apply(sighting.position_base_m)
            self._open.setdefault(track.number, []).append((place, inverse(spread)))
        return tracks

    def revisit(self) -> LoopClosure | None:
        """Look for things seen before, and put way and tracks right by them; None while nothing was seen again."""
        before, number_of = self.way.vectors(), dict(self._group)
        solved = self._paired()
        if solved is None and self.links:
            solved = self._solve(rounds=3)
        if solved is None:
            return None
        past = self.way.put(solved.solution.poses)
        self._place_tracks(solved, past)
        moves = self._moves(solved, before, number_of)
        return LoopClosure(past, solved.solution.last_covariance, moves)

    def things(self, tracks: Sequence[Track]) -> list[int]:
        """The number of the thing that each track is of, as far as it is known."""
        return [self._group[track.number] for track in tracks]

    def groups(self) -> dict[int, list[Track]]:
        """The tracks of each thing."""
        members: dict[int, list[Track]] = {}
        for track in self.tracker.tracks.values():
            members.setdefault(self._group[track.number], []).append(track)
        return members

    def _paired(self) -> _Solved | None:
        """The drive with what was now found to be one thing, None where nothing was, or where the way does not bear
        it."""
        groups = self.groups()
        seen = [track for track in self.tracker.in_view(self.way.odometer_m) if track.count >= self.rule.least]
        fresh = [track for track in seen if len(groups[self._group[track.number]]) == 1]
        candidates = self._candidates(fresh, groups)
        if not candidates:
            return None
        before = self._solve(rounds=2)
        pairings = [
            Pairing(before.row[track.number], before.row[group], 2.0 * self.rule.track.side_m2(track.extent_m))
            for track, group in candidates
        ]
        places, covariance = before.solution.landmarks, before.solution.covariance
        found = certain_pairings(pairings, places, covariance, self.rule.revisit, len(seen) - len(fresh))
        if not found:
            return None
        named = list(before.row)
        pairs, old = [(named[pairing.now], named[pairing.before]) for pairing in found], dict(self._group)
        self._group.update(pairs)
        after = self._solve(rounds=10)
        if any(after.misfit[number] > self.rule.misfit for number, _ in pairs):
            self._group = old
            self._refused.update(pairs)
            return None
        self.links += len(pairs)
        return after

    def _candidates(self, fresh: Sequence[Track], groups: dict[int, list[Track]]) -> list[tuple[Track, int]]:
        """Tracks in view, those seen most, with each group that may be the same: of its label, and seen before only."""
        pairs: list[tuple[Track, int]] = []
        own = {self._group[track.number] for track in fresh}
        for group, members in groups.items():
            if group in own or sum(track.count for track in members) < self.rule.least:
                continue
            last = max(track.last for track in members)
            pairs += [
                (track, group)
                for track in fresh
                if track.label == members[0].label and last < track.first and (track.number, group) not in self._refused
            ]
        most = sorted({track.number: track for track, _ in pairs}.values(), key=lambda track: -track.count)
        chosen = {track.number for track in most[: self.rule.revisit.most_now]}
        return [pair for pair in pairs if pair[0].number in chosen]

    def _solve(self, rounds: int) -> _Solved:
        """Least squares over way and landmarks as they are grouped."""
        counts: dict[int, int] = {}
        start: dict[int, Array] = {}
        for number, track in self.tracker.tracks.items():
            group = self._group[number]
            counts[group] = counts.get(group, 0) + track.count
            start.setdefault(group, track.position_m)
        row = {group: at for at, group in enumerate(g for g, count in counts.items() if count >= self.rule.least)}
        looks = [look for look in self._looks if self._group[look.track] in row]
        landmarks = np.array([start[group] for group in row]).reshape(-1, 2)
        known = LandmarkPriors(landmarks.copy(), np.zeros((len(row), 2, 2)))
        for number, (place, information) in self._known.items():
            known.place_m[row[self._group[number]]] = place
            known.information[row[self._group[number]]] = information
        solution = solve(
            self.way.vectors(), landmarks, self.way.chain(), self._as_arrays(looks, row), known, rounds=rounds
        )
        sums: dict[int, list[float]] = {}
        for look, chi2 in zip(looks, solution.chi2.tolist(), strict=True):
            sums.setdefault(look.track, []).append(chi2)
        return _Solved(solution, row, {number: sum(chi2) / len(chi2) for number, chi2 in sums.items()})

    def _as_arrays(self, looks: Sequence[_Observation], row: dict[int, int]) -> ObservationFactors:
        return ObservationFactors(
            np.array([look.keyframe for look in looks], dtype=np.intp),
            np.array([row[self._group[look.track]] for look in looks], dtype=np.intp),
            np.array([look.place_m for look in looks]).reshape(-1, 2),
            np.array([look.information for look in looks]).reshape(-1, 2, 2),
        )

    def _place_tracks(self, solved: _Solved, trajectory_correction: TrajectoryCorrection) -> None:
        """Tracks stand where their landmark does; those that are none yet move with the keyframe that saw them last."""
        for number, track in self.tracker.tracks.items():
            at = solved.row.get(self._group[number])
            if at is None:
                track.position_m = SE2(*trajectory_correction.moves[track.last]).apply(track.position_m)
            else:
                track.position_m = solved.solution.landmarks[at]

    def _moves(self, solved: _Solved, before: Array, number_of: dict[int, int]) -> dict[int, ObjectShift]:
        """Where each thing lies now, by its number before: its looks moved with their poses, and it by their mean."""
        after = solved.solution.poses
        rows = np.array([look.keyframe for look in self._looks], dtype=np.intp)
        places = np.array([look.place_m for look in self._looks]).reshape(-1, 2)
        shifts = points_from(after[rows], places) - points_from(before[rows], places)
        by: dict[int, list[Array]] = {}
        for look, shift in zip(self._looks, shifts, strict=True):
            by.setdefault(number_of[look.track], []).append(shift)
        unknown_m2, moves = solved.solution.last_covariance[:2, :2], {}
        for number, each in by.items():
            part_of = self._group[number]
            at = solved.row.get(part_of)
            covariance = solved.solution.covariance
            from_way_m2 = unknown_m2 if at is None else covariance[2 * at : 2 * at + 2, 2 * at : 2 * at + 2]
            moves[number] = ObjectShift(np.mean(each, axis=0), from_way_m2, part_of)
        return moves

    def _close_looks(self) -> None:
        """What one keyframe saw of a track becomes one look: repeated frames repeat each other's error."""
        own = np.eye(2) * self.rule.look_m**2
        for number, seen in self._open.items():
            total = np.sum([information for _, information in seen], axis=0)
            place = np.linalg.solve(total, np.sum([information @ place for place, information in seen], axis=0))
            spread = inverse(total) * len(seen) + own
            self._looks.append(_Observation(len(self.way) - 1, number, place, inverse(spread)))
        self._open.clear()

    def _thin_out(self) -> None:
        """Fewer keyframes of long ago; what was seen from those that go is seen from the ones before."""
        homes = self.way.thinned()
        for at, look in enumerate(self._looks):
            home, place = homes[look.keyframe]
            turn = place.rotation()
            self._looks[at] = _Observation(
                home, look.track, place.apply(look.place_m), turn @ look.information @ turn.T
            )
        for track in self.tracker.tracks.values():
            if track.first >= 0:
                track.first, track.last = homes[track.first][0], homes[track.last][0]

    def _forget(self) -> None:
        """Drop tracks out of view that never became landmarks, and where there are too many landmarks, the least seen
        of those that stand alone."""
        near = {track.number for track in self.tracker.in_view(self.way.odometer_m)}
        alone = [members[0] for members in self.groups().values() if len(members) == 1]
        may_go = [track for track in alone if track.number not in near and track.number not in self._known]
        spare = len(self.groups()) - self.rule.most
        may_go.sort(key=lambda track: track.count)
        gone = {track.number for at, track in enumerate(may_go) if track.count < self.rule.least or at < spare}
        if gone:
            for number in gone:
                del self.tracker.tracks[number], self._group[number]
            self._looks = [look for look in self._looks if look.track not in gone]
            self._refused = {pair for pair in self._refused if gone.isdisjoint(pair)}
