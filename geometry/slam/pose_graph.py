"""A drive as a graph of poses and landmarks: those observed again close loops, a bounded unit of work per frame."""

from __future__ import annotations

from collections.abc import Generator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from edgemap.geometry.objects.map_object import MapObject
from edgemap.geometry.observations.sighting import Sighting
from edgemap.geometry.se2 import SE2
from edgemap.geometry.slam.keyframes import KeyframeRule, KeyframeTrajectory, TrajectoryCorrection
from edgemap.geometry.slam.least_squares import (
    LandmarkFactors,
    ObservationFactors,
    Problem,
    Solution,
    inverse,
    solve,
)
from edgemap.geometry.slam.loop_hypotheses import LoopHypothesisRule, Pairing, certain_pairings
from edgemap.geometry.slam.tracks import Track, Tracker, TrackRule

Array = NDArray[np.float64]
Work = Generator[None, None, "_Solved | None"]


@dataclass(frozen=True, slots=True)
class GraphRule:
    """How a drive becomes a graph. view_m: standard deviation of what an object looks like from one keyframe, beside
    its sightings' own; merged_m: at least, of all that one keyframe saw of it after thinning. minimum: sightings that
    make a track a landmark. maximum: tracks kept. visits: tracks of one object kept apart, older ones become one.
    nearest: earlier objects weighed in one closure. every: keyframes between two closures. residual: mean squared
    residual of a track's observations above which its link is refused. gate: squared residual above which a link is
    taken back. still_m: a closure that finds no link and moves less than this leaves the poses as they are."""

    view_m: float = 0.15
    merged_m: float = 0.05
    minimum: int = 5
    maximum: int = 80
    visits: int = 3
    nearest: int = 40
    every: int = 4
    residual: float = 4.0
    gate: float = 11.83
    still_m: float = 0.01
    keyframes: KeyframeRule = field(default_factory=KeyframeRule)
    track: TrackRule = field(default_factory=TrackRule)
    hypotheses: LoopHypothesisRule = field(default_factory=LoopHypothesisRule)


@dataclass(frozen=True, slots=True, eq=False)
class _Observation:
    """A track seen from a keyframe, in that one's frame: position_m, information, and the shared bias of the mount."""

    position_m: Array
    information: Array
    bias_m: Array


@dataclass(frozen=True, slots=True, eq=False)
class _Solved:
    """row: of each landmark, by track. residual: mean squared residual of each track's observations. link_chi2: squared
    residual of each link, by its later track."""

    solution: Solution
    row: dict[int, int]
    residual: dict[int, float]
    link_chi2: dict[int, float]


class PoseGraph:
    """Fed every frame's motion and sightings. Every visit to an object is a track and a landmark of its own; a link
    says that two are one object, as far as it looks the same from both sides, and is taken back when it no longer fits.

    links: found so far and not taken back. What is due when depends on path and rotation only.
    """

    def __init__(self, rule: GraphRule | None = None) -> None:
        self.rule = rule or GraphRule()
        self.trajectory, self.tracker = KeyframeTrajectory(self.rule.keyframes), Tracker(self.rule.track)
        self.links = 0
        self._parent: dict[int, int] = {}
        self._open: dict[int, list[tuple[Array, Array, Array]]] = {}
        self._observations: dict[tuple[int, int], _Observation] = {}
        self._refused: set[tuple[int, int]] = set()
        self._bias = 0.0
        self._work: Work | None = None
        self._due = False

    def add_prior_landmarks(self, objects: Sequence[MapObject]) -> None:
        """Objects of an earlier map, in the trajectory's frame: observed again, they correct it."""
        for item in objects:
            track = self.tracker.begin(item.label, item.width_m, item.position_m, -1, -np.inf)
            track.count, track.prior_m2 = max(item.count, self.rule.minimum), item.covariance_m2

    def advance(self, motion: SE2, covariance: Array, stamp_s: float) -> None:
        """Move on; where a keyframe is due, what was seen from the one before becomes its observations."""
        if self.trajectory.is_due(motion, covariance):
            self._close_observations()
            self.trajectory.keep(stamp_s)
            self._due |= len(self.trajectory) % self.rule.every == 0

    def observe(self, sightings: Sequence[Sighting]) -> list[Track]:
        """Take in one frame's sightings, seen from where the trajectory ends now; the track of each."""
        trajectory = self.trajectory
        tracks = self.tracker.follow(sightings, trajectory.pose, len(trajectory) - 1, trajectory.odometer_m)
        rotation = trajectory.since.rotation()
        for track, sighting in zip(tracks, sightings, strict=True):
            bias_m = _bias(sighting)
            own = sighting.covariance_m2 + sighting.shared_m2 - np.outer(bias_m, bias_m)
            position = trajectory.since.apply(sighting.position_base_m)
            information = inverse(rotation @ own @ rotation.T)
            self._open.setdefault(track.number, []).append((position, information, rotation @ bias_m))
        return tracks

    def close_loops(self, now_s: float) -> TrajectoryCorrection | None:
        """One unit of work on the closure under way, or the next one where it is due; the correction that it ends with.

        now_s: stamp of the frame whose motion came last.
        """
        if self._work is None:
            if not self._due:
                return None
            self._due, self._work = False, self._closure()
        try:
            next(self._work)
        except StopIteration as end:
            self._work = None
            return None if end.value is None else self._corrected(end.value, now_s)
        return None

    def groups(self) -> dict[int, list[Track]]:
        """The tracks of each object, by the number of the first."""
        members: dict[int, list[Track]] = {}
        for number, track in self.tracker.tracks.items():
            members.setdefault(self._root(number), []).append(track)
        return members

    def _root(self, number: int) -> int:
        while number in self._parent:
            number = self._parent[number]
        return number

    def _closure(self) -> Work:
        """Link what is certainly one object and solve; links that do not fit are taken back."""
        self._bound()
        yield
        count, found = len(self._parent), {}
        groups = self.groups()
        visible = [
            track
            for track in self.tracker.in_view(self.trajectory.odometer_m)
            if track.count >= self.rule.minimum and track.last >= 0
        ]
        fresh = [track for track in visible if len(groups[self._root(track.number)]) == 1]
        if candidates := self._candidates(fresh, groups):
            before = yield from self._solve({root for _, root in candidates}, 2, covariances=False)
            pairings = [
                Pairing(before.row[track.number], before.row[root], self._apart_m2(track.number, root))
                for track, root in candidates
                if track.number in before.row and root in before.row
            ]
            solution, supported = before.solution, len(visible) - len(fresh)
            certain = yield from certain_pairings(
                pairings, solution.landmarks, solution.landmark_covariance, self.rule.hypotheses, supported
            )
            name = list(before.row)
            found = {name[pairing.now]: name[pairing.before] for pairing in certain}
            self._parent |= found
        if not self._parent and not count:
            return None
        after = yield from self._solve(set(), 8 if found else 3)
        while unfit := self._unfit(after, found):
            for number in unfit:
                self._refused.add((number, self._root(self._parent[number])))
                del self._parent[number]
            found = {number: first for number, first in found.items() if number in self._parent}
            after = yield from self._solve(set(), 8)
        self.links += len(self._parent) - count
        return after

    def _unfit(self, after: _Solved, found: Mapping[int, int]) -> list[int]:
        """Links to take back: all that were just found if one of these does not fit, else the worst of the others."""
        bad = {number: chi2 for number, chi2 in after.link_chi2.items() if chi2 > self.rule.gate}
        if any(number in bad or after.residual.get(number, 0.0) > self.rule.residual for number in found):
            return list(found)
        return [max(bad, key=lambda number: bad[number])] if bad else []

    def _apart_m2(self, later: int, first: int) -> float:
        """Variance of the distance of two tracks of one object, per axis: both are seen from some side, but an earlier
        map's object from many."""
        sides = 2.0 if self.tracker.tracks[first].prior_m2 is None else 1.0
        return sides * self.rule.track.side_m2(self.tracker.tracks[later].extent_m)

    def _candidates(self, fresh: Sequence[Track], groups: Mapping[int, list[Track]]) -> list[tuple[Track, int]]:
        """Tracks in view, those seen most often, with each earlier object that they may be: of the same label, the
        nearest ones, and not seen since."""
        fresh = sorted(fresh, key=lambda track: -track.count)[: self.rule.hypotheses.maximum_now]
        own = {self._root(track.number) for track in fresh}
        pairs: list[tuple[float, Track, int]] = []
        for root, members in groups.items():
            if root in own or sum(track.count for track in members) < self.rule.minimum:
                continue
            last, at = max(track.last for track in members), self.tracker.tracks[root].position_m
            pairs += [
                (float(np.hypot(*(track.position_m - at))), track, root)
                for track in fresh
                if track.label == members[0].label and last < track.first and (track.number, root) not in self._refused
            ]
        pairs.sort(key=lambda pair: (pair[0], pair[1].number, pair[2]))
        near = set(list(dict.fromkeys(root for _, _, root in pairs))[: self.rule.nearest])
        return sorted(
            ((track, root) for _, track, root in pairs if root in near), key=lambda pair: (-pair[0].count, pair[1])
        )

    def _solve(self, wanted: set[int], iterations: int, covariances: bool = True) -> Generator[None, None, _Solved]:
        """Least squares over trajectory and landmarks. wanted: earlier objects that are no landmarks otherwise."""
        tied = {*self._parent, *self._parent.values(), *wanted}
        observed = {number for _, number in self._observations}
        tracks = [
            track
            for track in self.tracker.tracks.values()
            if track.count >= self.rule.minimum and track.number in (observed if track.prior_m2 is None else tied)
        ]
        row = {track.number: at for at, track in enumerate(tracks)}
        landmarks = np.array([track.position_m for track in tracks]).reshape(-1, 2)
        information = np.array(
            [np.zeros((2, 2)) if track.prior_m2 is None else inverse(track.prior_m2) for track in tracks]
        ).reshape(-1, 2, 2)
        links = [(later, first) for later, first in self._parent.items() if later in row and first in row]
        factors = LandmarkFactors(
            landmarks.copy(),
            information,
            np.array([row[later] for later, _ in links], dtype=np.intp),
            np.array([row[first] for _, first in links], dtype=np.intp),
            np.array([self._apart_m2(later, first) for later, first in links]),
        )
        seen = [(at, item) for at, item in self._observations.items() if at[1] in row]
        observations = ObservationFactors(
            np.array([keyframe for (keyframe, _), _ in seen], dtype=np.intp),
            np.array([row[number] for (_, number), _ in seen], dtype=np.intp),
            np.array([item.position_m for _, item in seen]).reshape(-1, 2),
            np.array([item.information for _, item in seen]).reshape(-1, 2, 2),
            np.array([item.bias_m for _, item in seen]).reshape(-1, 2),
        )
        problem = Problem(self.trajectory.factors(), observations, factors)
        solution = yield from solve(problem, self.trajectory.vectors(), landmarks, self._bias, iterations, covariances)
        residual = np.bincount(observations.landmark, solution.chi2, len(tracks))
        residual /= np.maximum(np.bincount(observations.landmark, minlength=len(tracks)), 1)
        link_chi2 = {later: float(chi2) for (later, _), chi2 in zip(links, solution.link_chi2, strict=True)}
        return _Solved(solution, row, dict(zip(row, residual.tolist(), strict=True)), link_chi2)

    def _corrected(self, solved: _Solved, now_s: float) -> TrajectoryCorrection:
        """Poses and tracks stand where the solution has them; those that are no landmarks move with the keyframe that
        saw them last."""
        solution, poses = solved.solution, solved.solution.poses
        before = self.trajectory.vectors()[: len(poses)]
        if np.abs(poses - before).max() < self.rule.still_m:
            return self.trajectory.set_poses(before, solution.pose_covariances, now_s)
        self._bias = solution.bias
        correction = self.trajectory.set_poses(poses, solution.pose_covariances, now_s)
        for number, track in self.tracker.tracks.items():
            if (at := solved.row.get(number)) is not None:
                track.position_m = solution.landmarks[at]
            elif track.last >= 0:
                track.position_m = SE2(*correction.moves[track.last]).apply(track.position_m)
        return correction

    def _close_observations(self) -> None:
        """What one keyframe saw of a track becomes one observation: repeated frames repeat each other's error."""
        own = np.eye(2) * self.rule.view_m**2
        for number, seen in self._open.items():
            total = np.sum([information for _, information, _ in seen], axis=0)
            position = np.linalg.solve(total, np.sum([weight @ at for at, weight, _ in seen], axis=0))
            bias = np.mean([bias for _, _, bias in seen], axis=0)
            information = inverse(inverse(total) * len(seen) + own)
            self._observations[len(self.trajectory) - 1, number] = _Observation(position, information, bias)
        self._open.clear()

    def _bound(self) -> None:
        """Keep the graph's size: fewer keyframes of long ago, fewer tracks."""
        if len(self.trajectory) >= self.rule.keyframes.maximum:
            homes = self.trajectory.thin_out()
            for track in self.tracker.tracks.values():
                if track.first >= 0:
                    track.first, track.last = homes[track.first][0], homes[track.last][0]
            self._regroup({number: number for number in self.tracker.tracks}, homes)
        into = {number: number for number in self.tracker.tracks}
        near = {track.number for track in self.tracker.in_view(self.trajectory.odometer_m)}
        for members in self.groups().values():
            for track in members[1 : 1 + max(len(members) - self.rule.visits, 0)]:
                if track.number not in near:
                    into[track.number] = self._merge(track)
        own = [t for n, t in self.tracker.tracks.items() if into[n] == n and t.prior_m2 is None]
        excess = len(own) - self.rule.maximum
        linked = {*self._parent, *self._parent.values()}
        may_go = sorted((t for t in own if t.number not in near), key=lambda t: (t.number in linked, t.count))
        for at, track in enumerate(may_go):
            if at < excess or (track.count < self.rule.minimum and track.number not in linked):
                into[track.number] = self._unlink(track.number)
        if gone := {number for number, kept in into.items() if kept != number}:
            for number in gone:
                del self.tracker.tracks[number]
            self._refused = {pair for pair in self._refused if gone.isdisjoint(pair)}
            self._regroup(into)

    def _merge(self, track: Track) -> int:
        """One visit becomes part of the one that it is linked to; that one's number."""
        kept = self.tracker.tracks[self._unlink(track.number)]
        kept.count, kept.last = kept.count + track.count, max(kept.last, track.last)
        return kept.number

    def _unlink(self, number: int) -> int:
        """A track leaves its links to its parent, or to the first that is linked to it; that one's number, else -1."""
        children = [later for later, first in self._parent.items() if first == number]
        home = self._parent.pop(number, children[0] if children else -1)
        for later in children:
            self._parent[later] = home
        self._parent.pop(home, None) if home in children else None
        return home

    def _regroup(self, into: Mapping[int, int], homes: Sequence[tuple[int, SE2, Array]] | None = None) -> None:
        """Observations of tracks that became part of another, or were dropped (-1), from keyframes that belong to
        another now: what one keyframe saw of one track is one observation."""
        observations: dict[tuple[int, int], _Observation] = {}
        for (keyframe, number), item in self._observations.items():
            kept = number
            while kept >= 0 and into[kept] != kept:
                kept = into[kept]
            if kept < 0:
                continue
            if homes is not None and homes[keyframe][0] != keyframe:
                keyframe, place, covariance = homes[keyframe]
                item = _seen_before(item, place, covariance)
            if (other := observations.get((keyframe, kept))) is not None:
                item = self._joined(other, item)
            observations[keyframe, kept] = item
        self._observations = observations

    def _joined(self, first: _Observation, second: _Observation) -> _Observation:
        total = first.information + second.information
        weighted = first.information @ first.position_m + second.information @ second.position_m
        position = np.asarray(np.linalg.solve(total, weighted), dtype=np.float64)
        bound = 1.0 / self.rule.merged_m**2 / float(np.linalg.eigvalsh(total)[-1])
        return _Observation(position, total * min(1.0, bound), (first.bias_m + second.bias_m) / 2.0)


def _seen_before(item: _Observation, place: SE2, covariance: Array) -> _Observation:
    """An observation as if made from an earlier pose, from which its own is known with a covariance (3, 3)."""
    turn = place.rotation()
    lever_x_m, lever_y_m = turn @ item.position_m
    wrt_pose = np.array([[1.0, 0.0, -lever_y_m], [0.0, 1.0, lever_x_m]])
    own = turn @ inverse(item.information) @ turn.T + wrt_pose @ covariance @ wrt_pose.T
    return _Observation(place.apply(item.position_m), inverse(own), turn @ item.bias_m)


def _bias(sighting: Sighting) -> Array:
    """How far one standard deviation of the mount's error moves a sighting, (2,), outwards: what all have in common."""
    values, vectors = np.linalg.eigh(sighting.shared_m2)
    outwards = np.sign(vectors[:, 1] @ sighting.position_base_m) or 1.0
    return vectors[:, 1] * (np.sqrt(max(values[1], 0.0)) * outwards)
