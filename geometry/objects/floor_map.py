"""The default clustering: landmarks that are one object under both covariances.

Two boxes of one frame never become one object, so chairs that stand closer than the paper's 1 m stay separate.
Association is repeated around every landmark that is new, was observed from another keyframe, or moved. Objects that
prove to be one merge and keep the older id; when one object proves to be two, the larger part keeps the id. Everything
moves with the keyframes that observed it.
"""

import math
from collections import Counter, defaultdict
from collections.abc import Generator, Iterable, Mapping, Sequence, Set
from dataclasses import replace
from itertools import combinations, islice

import numpy as np

from edgemap.geometry.arrays import Array
from edgemap.geometry.errors import MapError
from edgemap.geometry.grid.occupancy_grid import OccupancyGrid
from edgemap.geometry.map_object import Ids, MapObject, as_places, id_order
from edgemap.geometry.objects.association import AssociationRule, grouped
from edgemap.geometry.objects.candidates import Candidate, Overlaps, label_posterior
from edgemap.geometry.objects.footprint import DIRECTIONS, fitted
from edgemap.geometry.objects.positions import Positions
from edgemap.geometry.observations.sighting import PlacedSighting
from edgemap.geometry.slam.loop_closure import closure
from edgemap.geometry.slam.object_landmarks import Landmark, Sums, rotations, stacked
from edgemap.geometry.slam.pose_graph import GraphRule, PoseGraph
from edgemap.geometry.trajectory_correction import TrajectoryCorrection, composed

MERGED_IDS = 4096  # merged ids that are reported; older ones are dropped
FITTED = 2  # footprints at most in one update, which bounds its time


class FloorMap:
    """Objects of landmarks, fed frame by frame; deterministic ids such as `chair-3` in order of appearance, none of
    those that are `taken` by an earlier map. graph: the landmarks and the trajectory that observed them."""

    def __init__(
        self, rule: AssociationRule | None = None, graph: GraphRule | None = None, taken: Iterable[str] = ()
    ) -> None:
        self.rule = rule or AssociationRule()
        self.graph = PoseGraph(graph, self.rule.min_count)
        self.merged: dict[str, str] = {}
        self._objects: dict[str, Candidate] = {}
        self._owner: dict[int, Candidate] = {}  # by landmark
        self._positions: defaultdict[str, Positions[int]] = defaultdict(Positions)  # of each label's landmarks
        self._ids = Ids(taken)
        self._changed: dict[str, None] = {}
        self._overlaps = Overlaps(self._objects, self.rule.overlap)
        self._shown: dict[str, MapObject] = {}  # by id, in its order
        self._listed: list[MapObject] | None = []
        self.grid: OccupancyGrid | None = None  # that footprints are fitted to
        self._unfitted: dict[str, None] = {}  # ids of objects whose outlines have changed, oldest first
        self._is_due = False  # maintenance, and its work that has begun
        self._work: Generator[None, None, TrajectoryCorrection | None] | None = None

    def continued(self, saved: Sequence[MapObject], became: Mapping[str, str] | None = None) -> "FloorMap":
        """A map that continues an earlier one, whose objects stay unchanged until they are observed again; new objects
        get no id of this map. became: after a relocalisation, the new ids of this map's objects. Raises MapError for a
        repeated id.
        """
        ids, became = {item.id for item in saved}, became or {}
        if len(ids) < len(saved):
            raise MapError(f"{len(saved)} objects share {len(ids)} ids: the map is damaged")
        floor_map = FloorMap(self.rule, self.graph.rule, ids)
        floor_map._ids |= self._ids
        floor_map.merged = {old: became.get(new, new) for old, new in self.merged.items()}
        floor_map.merged |= {old: new for old, new in became.items() if old != new}
        for item in saved:
            landmark = floor_map.graph.add_saved(item)
            # Enough for an object, so that what stands there now outweighs what stood there.
            landmark.sums.weight = min(landmark.sums.weight, float(floor_map.rule.min_count))
            floor_map._positions[item.label].set(landmark.number, landmark.position_m)
            entry = Candidate(item.id, item.label, [landmark])
            floor_map._objects[item.id] = floor_map._owner[landmark.number] = entry
            floor_map._change(item.id)
        return floor_map

    def update(self, sightings: list[PlacedSighting]) -> list[str]:
        """Updates the map with all sightings of one frame. Returns the id of each one's object."""
        near = self.graph.in_view() if sightings else []
        before = {one.number: (one.last, len(one.distinct)) for one in near}
        landmarks = self.graph.observe(sightings)
        for label in dict.fromkeys(placed.label for placed in sightings):
            same_label = [one for one in landmarks if one.label == label]
            changed = [one for one in same_label if before.get(one.number) != (one.last, len(one.distinct))]
            self._place(label, same_label, changed)
        self._fit_footprints()
        return [self._owner[one.number].id for one in landmarks]

    def maintain(self, is_keyframe: bool, closes_loops: bool) -> tuple[bool, TrajectoryCorrection | None]:
        """One unit of the work that bounds the map's size and closes loops, every few keyframes. Returns whether it has
        ended, and the correction that it ends with. is_keyframe: whether the latest frame is one.

        Counts frames, path and rotation, never time: the same frames give the same corrections.
        """
        self._is_due |= is_keyframe and len(self.graph.trajectory) % self.graph.rule.every == 0
        if self._is_due and self._work is None:
            self._is_due, self._work = False, self._maintenance(closes_loops)
        if self._work is None:
            return False, None
        try:
            next(self._work)
        except StopIteration as end:
            self._work = None
            return True, end.value
        return False, None

    def _maintenance(self, closes_loops: bool) -> Generator[None, None, TrajectoryCorrection | None]:
        self.bound()
        yield
        self.graph.drop_keyframes()
        yield
        return (yield from closure(self.graph)) if closes_loops else None

    def bound(self) -> None:
        """Bounds the map's size on a drive of any length: keeps only the latest landmarks that never became an object,
        as many as a closure solves for, and merges visits to one object. Not during a loop closure.
        """
        self._refresh()
        weak = [item for item in self._objects.values() if self._overlaps.best(item.id) not in self._shown]
        weak.sort(key=lambda item: -max(one.sums.last_seen_s for one in item.landmarks))
        for item in weak[self.graph.rule.maximum :]:
            self._remove(item.id)
        in_view = set(self.graph.in_view())
        for item in self._objects.values():
            self._join_visits(item, in_view)
        gone = {number for number, one in self.graph.landmarks.items() if one.gone}
        if gone:
            self.graph.remove(gone)

    def objects(self) -> list[MapObject]:
        """Objects with enough evidence, one in each place, ordered by id."""
        self._refresh()
        if self._listed is None:
            self._listed = list(self._shown.values())
        return self._listed

    def near(self, point_m: Array, reach_m: float) -> list[MapObject]:
        """The objects within a distance of a point (2,), ordered by id."""
        self._refresh()
        ids = [identity for identity in self._overlaps.positions.within(point_m, reach_m) if identity in self._shown]
        return [self._shown[identity] for identity in sorted(ids, key=id_order)]

    def shown_as(self, identity: str) -> str:
        """The id under which the map shows what was once this object."""
        self._refresh()
        return self._overlaps.best(self.merged.get(identity, identity))

    def moved(self) -> None:
        """Applies a trajectory correction, or another tilt of the mount: what this run has observed moves with its
        keyframes, and association is repeated."""
        self.graph.place(self.graph.landmarks.values())
        moved: defaultdict[str, list[Landmark]] = defaultdict(list)
        for one in self.graph.landmarks.values():
            if one.keyframes and one.number in self._owner:
                moved[one.label].append(one)
        for label, landmarks in moved.items():
            self._place(label, landmarks, landmarks)

    def set_presence(self, identity: str, probability: float) -> None:
        """Sets the probability that an object is still there, which scales its confidence."""
        item = self._objects.get(identity)
        if item is not None and item.presence != probability:
            item.presence = probability
            self._change(identity)

    def drop(self, identity: str) -> None:
        """Removes an object; its id is not used again."""
        self._refresh()
        for candidate in self._overlaps.members.get(identity, ()):
            self._remove(candidate.id)

    def _place(self, label: str, landmarks: Sequence[Landmark], changed: Sequence[Landmark]) -> None:
        """Landmarks of a label have new positions. changed: those among them whose association is repeated."""
        for one in landmarks:
            self._positions[label].set(one.number, one.position_m)
        if changed:
            self._group(label, changed)
        for one in landmarks:
            self._change(self._owner[one.number].id)
        self._unfitted |= dict.fromkeys(self._owner[one.number].id for one in changed)

    def _group(self, label: str, changed: Sequence[Landmark]) -> None:
        """Repeats the association of all landmarks within reach of these."""
        affected = self._around(label, changed)
        before = {owner.id: owner for one in affected if (owner := self._owner.get(one.number))}
        rule = self.graph.rule.landmarks
        groups = grouped(affected, [self.graph.root(one.number) for one in affected], rule)
        groups.sort(key=lambda group: min((one.sums.first_seen_s, one.number) for one in group))
        homes = self._homes(groups)
        for group, names in zip(groups, homes, strict=True):
            identity = names[0] if names else self._ids.new(label)
            presence = max((before[name].presence for name in names), default=1.0)
            footprint = before[names[0]].footprint if names else None
            item = self._objects[identity] = Candidate(identity, label, group, presence, footprint)
            self._change(identity)
            for one in group:
                self._owner[one.number] = item
        self._rename({name: names[0] for names in homes for name in names[1:]})

    def _around(self, label: str, changed: Sequence[Landmark]) -> list[Landmark]:
        """These landmarks, all within reach of one of them, and all others of the same objects."""
        places_m, reach_m = [one.position_m for one in changed], self.graph.rule.landmarks.reach_m
        numbers = set(self._positions[label].within(places_m, reach_m))
        owners = {owner.id: owner for number in numbers if (owner := self._owner.get(number))}
        numbers |= {one.number for owner in owners.values() for one in owner.landmarks}
        return [self.graph.landmarks[number] for number in sorted(numbers)]

    def _join_visits(self, item: Candidate, in_view: Set[Landmark]) -> None:
        """Joins the oldest visits to an object until few are left; those that are in view go on."""
        while len(visits := [one for one in item.landmarks if one.saved is None]) > self.graph.rule.visits:
            ended = sorted((one for one in visits if one not in in_view), key=lambda one: one.number)
            pairs = ((kept, gone) for kept, gone in combinations(ended, 2) if not kept.is_distinct(gone))
            if (pair := next(pairs, None)) is None:
                return
            self.graph.join(*pair)
            self._release(item, pair[1])
            item.landmarks.remove(pair[1])
            self._change(item.id)

    def _homes(self, groups: list[list[Landmark]]) -> list[list[str]]:
        """Ids that each group keeps, oldest first: an id stays with the object of an earlier map that had it,
        else it goes to the group with most of its sightings."""
        shares: defaultdict[str, Counter[int]] = defaultdict(Counter)
        for number, group in enumerate(groups):
            for one in group:
                if (owner := self._owner.get(one.number)) is not None:
                    shares[owner.id][number] += one.sums.count
        saved = {one.saved.id: number for number, group in enumerate(groups) for one in group if one.saved}
        homes: list[list[str]] = [[] for _ in groups]
        for identity in sorted(shares, key=id_order):
            share, home = shares[identity], saved.get(identity)
            homes[min(share, key=lambda number: (number != home, -share[number], number))].append(identity)
        return homes

    def _rename(self, renamed: dict[str, str]) -> None:
        """Maps ids that no longer exist to those that replaced them."""
        if renamed:
            for old in renamed:
                del self._objects[old]
                self._change(old)
            merged = {old: renamed.get(new, new) for old, new in self.merged.items()} | renamed
            self.merged = dict(islice(merged.items(), max(len(merged) - MERGED_IDS, 0), None))

    def _remove(self, identity: str) -> None:
        item = self._objects.pop(identity)
        for one in item.landmarks:
            one.gone = True
            self._release(item, one)
        self._change(identity)

    def _release(self, item: Candidate, landmark: Landmark) -> None:
        """A landmark leaves the map."""
        del self._owner[landmark.number]
        self._positions[item.label].remove(landmark.number)

    def _change(self, identity: str) -> None:
        self._changed[identity] = None
        if (item := self._objects.get(identity)) is not None:
            item.is_estimated = False

    def _refresh(self) -> None:
        """Updates what the map shows of everything that changed since the last call."""
        if not self._changed:
            return
        for identity in self._changed:
            if (item := self._objects.get(identity)) is not None:
                item.estimate(self.graph.rule.landmarks)
            self._overlaps.change(identity)
        self._changed, self._listed, appeared = {}, None, False
        for identity in self._overlaps.settle():
            members = self._overlaps.members.get(identity)
            if members and (shown := self._as_map_object(members)):
                appeared |= identity not in self._shown
                self._shown[identity] = shown
            else:
                self._shown.pop(identity, None)
        if appeared:
            self._shown = dict(sorted(self._shown.items(), key=lambda entry: (id_order(entry[0]), entry[0])))

    def _as_map_object(self, members: list[Candidate]) -> MapObject | None:
        """Candidates in one place as one object; None where their evidence together does not suffice."""
        best, named = members[0], defaultdict[str, float](float)
        for one in members:
            named[one.label] += one.sums.weight
        others = sum(weight for label, weight in named.items() if label != best.label)
        if best.saved is None and best.sums.weight + others < self.rule.min_count:
            return None
        labels, confidence = label_posterior(named, self._overlaps.rule), best.confidence(self.rule.min_count)
        if best.saved is not None and len(best.landmarks) == 1:  # not seen since
            labels = best.saved.labels or labels
            return replace(best.saved, id=best.id, confidence=confidence * best.presence, labels=labels)
        shape, at = best.saved and best.saved.measured, best.position_m
        if best.footprint is not None:
            shape, at = best.footprint.shape, at + best.footprint.offset_m
        plain = best.sums.as_object(best.id, best.label, at, best.covariance_m2)
        places = outermost(self._views(best.landmarks), best.position_m)
        return replace(plain, confidence=confidence * best.presence, seen_from_m=places, labels=labels, measured=shape)

    def _fit_footprints(self) -> None:
        """Fits the footprints of a few objects whose outlines have changed, the oldest change first."""
        for identity in list(islice(self._unfitted, FITTED)):
            del self._unfitted[identity]
            if (item := self._objects.get(identity)) is not None:
                self._change(identity)
                item.estimate(self.graph.rule.landmarks)
                outlines, saved = self._outlines(item.landmarks), item.saved and item.saved.measured
                item.footprint = fitted(
                    item.label, item.width_m, item.position_m, outlines, self.grid, self.rule.footprint, saved
                )

    def _outlines(self, landmarks: Sequence[Landmark]) -> Array:
        """Mean outline of a box in each keyframe that has any, (N, 3, 2), map frame."""
        keyframes, rows = stacked(landmarks)
        some = rows[:, Sums.OUTLINED].ravel() > 0.0
        local = (rows[some, Sums.OUTLINE] / rows[some, Sums.OUTLINED]).reshape(-1, 3, 2)
        poses = self.graph.trajectory.poses[keyframes[some]].reshape(-1, 3)
        return local @ rotations(poses[:, 2]).transpose(0, 2, 1) + poses[:, None, :2]

    def _views(self, landmarks: Sequence[Landmark]) -> Array:
        """Positions (N, 2) that landmarks were observed from, those of an earlier map first."""
        saved = [view for one in landmarks if one.saved for view in one.saved.seen_from_m]
        keyframes, rows = stacked(landmarks)
        local = np.column_stack([rows[:, Sums.VIEW], np.zeros(len(rows))])
        poses = self.graph.trajectory.poses[keyframes].reshape(-1, 3)
        return np.concatenate([np.array(saved).reshape(-1, 2), composed(poses, local)[:, :2]])


def outermost(places_m: Array, position_m: Array) -> tuple[tuple[float, float], ...]:
    """Of the positions (N, 2) from which an object at (2,) was observed, the farthest in each direction, in their
    order: the lines of sight from nearer ones cover the same floor.
    """
    away_m = places_m - position_m
    sector = np.floor((np.arctan2(away_m[:, 1], away_m[:, 0]) / math.tau + 0.5) * DIRECTIONS) % DIRECTIONS
    farthest_first = np.argsort(-np.square(away_m).sum(axis=1), kind="stable")
    rows = np.sort(farthest_first[np.unique(sector[farthest_first], return_index=True)[1]])
    return as_places(places_m[rows])
