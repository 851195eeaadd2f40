"""A drive as a graph of poses and landmarks: those observed again close loops, a bounded unit of work per frame."""

import math
from collections import Counter
from collections.abc import Generator, Iterable, Mapping, Sequence, Set
from dataclasses import dataclass, field

import numpy as np

from edgemap.geometry.arrays import Array
from edgemap.geometry.objects.map_object import MapObject
from edgemap.geometry.observations.sighting import Sighting
from edgemap.geometry.se2 import SE2
from edgemap.geometry.slam.keyframes import KeyframeRule, KeyframeTrajectory, LandmarkCorrection, TrajectoryCorrection
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

Work = Generator[None, None, "_Solved | None"]


@dataclass(frozen=True, slots=True)
class GraphRule:
    """How a drive becomes a graph. view_m: standard deviation of what an object looks like from one keyframe, beside
    its sightings' own; merged_m: at least, of all that one keyframe saw of it in visits that were joined. minimum:
    sightings that make a track a landmark. maximum: tracks kept. visits: tracks of one object kept apart, older ones
    become one. views: keyframes of long ago that see an object, from which on one more of them tells nothing new.
    nearest: earlier objects weighed in one closure. every: keyframes between two closures. residual: mean squared
    residual of a track's observations above which its link is refused. gate: squared residual above which a link is
    taken back. still_m: a closure that finds no link and moves less than this leaves the poses as they are."""

    view_m: float = 0.15
    merged_m: float = 0.05
    minimum: int = 5
    maximum: int = 80
    visits: int = 3
    views: int = 6
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
        self._became: dict[int, int] = {}  # tracks that are part of another since `landmarks` was last asked
        self._bias, self._moves_m = 0.0, dict[int, Array]()
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

    def landmarks(self) -> LandmarkCorrection:
        """What the last correction says of landmarks: of all tracks that are kept, and of those that became part of
        another since this was last asked."""
        became, self._became = self._became, {}
        known = {number: self._root(number) for number in self.tracker.tracks}
        since_s = self.trajectory.stamps_s[len(self.trajectory) // 2] if self._is_full else -math.inf
        known |= {number: known[kept] for number, kept in became.items()}
        return LandmarkCorrection(known, self._moves_m, since_s)

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
        in_view = {
            track.number
            for track in self.tracker.in_view(self.trajectory.odometer_m)
            if track.count >= self.rule.minimum and track.last >= 0
        }
        fresh = self._unlinked(groups, in_view)
        if candidates := self._candidates(fresh, groups):
            before = yield from self._solve({root for _, root in candidates}, 2, covariances=False)
            pairings = [
                Pairing(before.row[track.number], before.row[root], self._apart_m2(track.number, root))
                for track, root in candidates
                if track.number in before.row and root in before.row
            ]
            supported = sum(len(groups[self._root(number)]) > 1 for number in in_view)
            certain = yield from certain_pairings(
                pairings,
                before.solution.landmarks,
                before.solution.landmark_covariance,
                self.rule.hypotheses,
                supported,
            )
            name = list(before.row)
            found = self._witnessed({name[pairing.now]: name[pairing.before] for pairing in certain})
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

    @property
    def _is_full(self) -> bool:
        """Whether keyframes have to go, and with them what was not recognised."""
        return len(self.trajectory) >= self.rule.keyframes.maximum

    def _unlinked(self, groups: Mapping[int, list[Track]], in_view: Set[int]) -> list[Track]:
        """Tracks that are no object seen before, so far: those in view, most sightings first, then, before they have to
        go, those that passed without having been recognised, the last one first."""
        since = len(self.trajectory) // 2 if self._is_full else len(self.trajectory)
        found = [
            track
            for (track, *others) in groups.values()
            if not others and track.count >= self.rule.minimum and (track.number in in_view or track.last >= since)
        ]
        found.sort(key=lambda track: (0, -track.count) if track.number in in_view else (1, -track.last))
        return found[: self.rule.hypotheses.maximum_now]

    def _witnessed(self, found: Mapping[int, int]) -> dict[int, int]:
        """Links of tracks that were seen about when enough of other objects were, which are or become linked: one
        object alone, however often it was seen, says nothing."""
        tracks, slack = self.tracker.tracks, self.rule.every
        linked = {number: self._root(number) for number in (*self._parent, *self._parent.values())} | dict(found)

        def witnesses(number: int, root: int) -> int:
            first, last = tracks[number].first - slack, tracks[number].last + slack
            near = {at for other, at in linked.items() if tracks[other].first <= last and tracks[other].last >= first}
            return len(near | {root})

        return {
            number: root for number, root in found.items() if witnesses(number, root) >= self.rule.hypotheses.minimum
        }

    def _candidates(self, fresh: Sequence[Track], groups: Mapping[int, list[Track]]) -> list[tuple[Track, int]]:
        """Tracks with each earlier object that they may be: of the same label, not seen since, the nearest ones; of two
        in one place the one that was seen more often."""
        counts = {root: sum(track.count for track in members) for root, members in groups.items()}
        earlier = sorted((root for root in groups if counts[root] >= self.rule.minimum), key=lambda root: -counts[root])
        pairs: list[tuple[float, Track, int]] = []
        for track in fresh:
            chosen: list[Array] = []
            for root in earlier:
                at = self.tracker.tracks[root].position_m
                if (
                    groups[root][0].label == track.label
                    and max(member.last for member in groups[root]) < track.first
                    and (track.number, root) not in self._refused
                    and track.beside.isdisjoint(member.number for member in groups[root])
                    and all(math.hypot(*(at - other)) > self.rule.hypotheses.same_m for other in chosen)
                ):
                    chosen.append(at)
                    pairs.append((math.hypot(*(track.position_m - at)), track, root))
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
        problem = Problem(self.trajectory.factors(), observations, factors, self.trajectory.factors(stated=True))
        solution = yield from solve(problem, self.trajectory.vectors(), landmarks, self._bias, iterations, covariances)
        residual = np.bincount(observations.landmark, solution.chi2, len(tracks))
        residual /= np.maximum(np.bincount(observations.landmark, minlength=len(tracks)), 1)
        link_chi2 = {later: float(chi2) for (later, _), chi2 in zip(links, solution.link_chi2, strict=True)}
        return _Solved(solution, row, dict(zip(row, residual.tolist(), strict=True)), link_chi2)

    def _corrected(self, solved: _Solved, now_s: float) -> TrajectoryCorrection:
        """Poses and tracks stand where the solution has them; those that are no landmarks move with the keyframe that
        saw them last."""
        solution, poses, self._moves_m = solved.solution, solved.solution.poses, {}
        before = self.trajectory.vectors()[: len(poses)]
        if np.abs(poses - before).max() < self.rule.still_m:
            return self.trajectory.set_poses(before, solution.pose_covariances, now_s)
        self._bias = solution.bias
        correction = self.trajectory.set_poses(poses, solution.pose_covariances, now_s)
        at_m = {number: track.position_m for number, track in self.tracker.tracks.items()}
        for number, track in self.tracker.tracks.items():
            if (at := solved.row.get(number)) is not None:
                track.position_m = solution.landmarks[at]
            elif track.last >= 0:
                track.position_m = SE2(*correction.moves[track.last]).apply(track.position_m)
        self._moves_m = {number: track.position_m - at_m[number] for number, track in self.tracker.tracks.items()}
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
        self._drop_keyframes()
        near = {track.number for track in self.tracker.in_view(self.trajectory.odometer_m)}
        observed = {number for _, number in self._observations}
        into = {number: number for number in self.tracker.tracks}

        def leave(tracks: Iterable[Track]) -> None:
            for track in tracks:
                if track.number not in near and into[track.number] == track.number:
                    into[track.number] = self._merge(track)
                    if into[track.number] < 0 and len(around := self._around(track)) == 1:
                        self._became[track.number] = around[0]

        for members in self.groups().values():
            leave(members[1 : 1 + max(len(members) - self.rule.visits, 0)])
        own = [track for track in self.tracker.tracks.values() if track.prior_m2 is None]
        linked = {*self._parent, *self._parent.values()}
        leave(track for track in own if track.number not in observed)
        old = len(self.trajectory) // 2
        single = [track for track in own if track.number not in linked]
        leave(t for t in single if t.count < self.rule.minimum or (t.last < old and self._around(t)))
        excess = sum(into[track.number] == track.number for track in own) - self.rule.maximum
        own = [track for track in own if track.number not in near and into[track.number] == track.number]
        leave(sorted(own, key=lambda track: (track.number not in self._parent, track.count))[: max(excess, 0)])
        if gone := {number for number, kept in into.items() if kept != number}:
            self._replace(into, gone)

    def _replace(self, into: dict[int, int], gone: Set[int]) -> None:
        """Tracks that became part of another, or of none (-1), leave; what one keyframe saw of one track is one
        observation."""
        for number in into:
            while into[number] >= 0 and into[into[number]] != into[number]:
                into[number] = into[into[number]]
        became = {number: into[number] for number in gone}
        became |= {number: into[kept] for number, kept in self._became.items()}
        self._became = {number: kept for number, kept in became.items() if kept >= 0}
        for number in gone:
            if (kept := into[number]) >= 0:
                self.tracker.tracks[kept].beside |= self.tracker.tracks[number].beside
            del self.tracker.tracks[number]
        for track in self.tracker.tracks.values():
            track.beside = {into[number] for number in track.beside} - {-1, track.number}
        self._refused = {pair for pair in self._refused if gone.isdisjoint(pair)}
        observations: dict[tuple[int, int], _Observation] = {}
        for (keyframe, number), item in self._observations.items():
            if (kept := into[number]) >= 0:
                other = observations.get((keyframe, kept))
                observations[keyframe, kept] = item if other is None else self._joined(other, item)
        self._observations = observations

    def _around(self, track: Track) -> list[int]:
        """A graph that is full: the landmarks of its label where a track lies that was never recognised."""
        return [
            other.number
            for other in self.tracker.tracks.values()
            if self._is_full
            and other.label == track.label
            and other.number == self._root(other.number)
            and other.number not in track.beside
            and other.count > max(track.count, self.rule.minimum)
            and math.hypot(*(other.position_m - track.position_m)) < self.rule.track.reach_m
        ]

    def _drop_keyframes(self) -> None:
        """Too many: of the older half those go, with their observations, whose objects others see often enough, the
        newest of them first. So the first ones in a place stay, and whatever is seen later is known against them."""
        excess, half = len(self.trajectory) - self.rule.keyframes.maximum, len(self.trajectory) // 2
        if excess <= 0:
            return
        seen: dict[int, set[int]] = {row: set() for row in range(1, half)}
        for row, number in self._observations:
            if row in seen and self.tracker.tracks[number].count >= self.rule.minimum:
                seen[row].add(self._root(number))
        views = Counter(root for roots in seen.values() for root in roots)
        gone: set[int] = set()
        for _ in range(excess):
            scarcest = {row: min([self.rule.views, *(views[root] for root in roots)]) for row, roots in seen.items()}
            gone.add(row := max(scarcest, key=lambda row: (scarcest[row], row)))
            views.subtract(seen.pop(row))
        self.trajectory.drop(gone)
        now = (np.cumsum([row not in gone for row in range(len(self.trajectory) + excess)]) - 1).tolist()
        for track in self.tracker.tracks.values():
            if track.first >= 0:
                track.first, track.last = now[track.first], now[track.last]
        self._observations = {
            (now[row], number): item for (row, number), item in self._observations.items() if row not in gone
        }

    def _merge(self, track: Track) -> int:
        """One visit becomes part of the one that it is linked to; that one's number, -1 where there is none."""
        if (number := self._unlink(track.number)) >= 0:
            kept = self.tracker.tracks[number]
            kept.count, kept.last = kept.count + track.count, max(kept.last, track.last)
        return number

    def _unlink(self, number: int) -> int:
        """A track leaves its links to its parent, or to the first that is linked to it; that one's number, else -1."""
        children = [later for later, first in self._parent.items() if first == number]
        home = self._parent.pop(number, children[0] if children else -1)
        for later in children:
            self._parent[later] = home
        self._parent.pop(home, None) if home in children else None
        return home

    def _joined(self, first: _Observation, second: _Observation) -> _Observation:
        total = first.information + second.information
        weighted = first.information @ first.position_m + second.information @ second.position_m
        position = np.asarray(np.linalg.solve(total, weighted), dtype=np.float64)
        bound = 1.0 / self.rule.merged_m**2 / float(np.linalg.eigvalsh(total)[-1])
        return _Observation(position, total * min(1.0, bound), (first.bias_m + second.bias_m) / 2.0)


def _bias(sighting: Sighting) -> Array:
    """How far one standard deviation of the mount's error moves a sighting, (2,), outwards: what all have in common."""
    values, vectors = np.linalg.eigh(sighting.shared_m2)
    outwards = np.sign(vectors[:, 1] @ sighting.position_base_m) or 1.0
    return vectors[:, 1] * (np.sqrt(max(values[1], 0.0)) * outwards)
