"""The default clustering: sightings that are one object under both covariances, whatever their order.

Two boxes of one frame never become one object, so chairs that stand closer than the paper's 1 m stay apart. What is one
object is decided again, for all that is linked with a frame's sightings, from the pools that all sightings ever went
into. Objects that turn out to be one merge, and the older id stays; the larger part of one that turns out to be two
keeps its id. Everything moves with the pose that it was seen from.
"""

import math
from bisect import bisect_left
from collections import Counter, defaultdict
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import islice

import numpy as np

from edgemap.geometry.arrays import Array
from edgemap.geometry.errors import MapError
from edgemap.geometry.objects.association import AssociationRule, Estimate
from edgemap.geometry.objects.class_posterior import Candidate, Overlaps, label_posterior
from edgemap.geometry.objects.map_object import MapObject, id_order
from edgemap.geometry.objects.observation_pool import (
    SAVED_SIDE,
    VIEW_M,
    ObservationPool,
    keys_of,
    move_views,
    outermost,
)
from edgemap.geometry.objects.pool_index import PoolIndex
from edgemap.geometry.observations.class_extents import footprint_m
from edgemap.geometry.observations.sighting import PlacedSighting
from edgemap.geometry.slam.keyframes import LandmarkCorrection, TrajectoryCorrection

MERGED_IDS = 4096  # merged ids that are reported; older ones are dropped


@dataclass(slots=True, eq=False)
class _Object:
    """Sightings of one label that are one object. pools: what it is made of. presence: probability that it
    still stands there.
    estimate: None until asked for."""

    id: str
    label: str
    pools: list[ObservationPool]
    presence: float = 1.0
    estimate: Estimate | None = None

    def estimated(self, rule: AssociationRule) -> Estimate:
        """Position and covariance from its pools."""
        if self.estimate is None:
            self.estimate = Estimate(self.pools, rule)
        return self.estimate


class FloorMap:
    """Objects by association, fed frame by frame; deterministic ids such as `chair-3` in order of appearance."""

    movable = True

    def __init__(self, rule: AssociationRule | None = None) -> None:
        self.rule = rule or AssociationRule()
        self.merged: dict[str, str] = {}
        self._pools: dict[str, PoolIndex] = {}
        self._objects: dict[str, _Object] = {}
        self._owner: dict[ObservationPool, _Object] = {}
        self._issued: Counter[str] = Counter()
        self._frames = 0
        self._pending: dict[ObservationPool, None] = {}
        self._changed: dict[str, None] = {}
        self._overlaps = Overlaps(self.rule.overlap)
        self._landmarks: Mapping[int, int] = {}  # of tracks
        self._shown: dict[str, MapObject] = {}
        self._order: list[tuple[tuple[str, int], str]] = []  # of what is shown, sorted
        self._ordered: list[MapObject] = []  # in that order
        self._listed: list[MapObject] | None = []

    @classmethod
    def after(cls, saved: Sequence[MapObject], rule: AssociationRule | None = None) -> "FloorMap":
        """An empty map whose ids go on where an earlier map's end, so that none is given twice."""
        floor_map = cls(rule)
        for item in saved:
            label, number = id_order(item.id)
            floor_map._issued[label] = max(floor_map._issued[label], number)
        return floor_map

    @classmethod
    def continued(
        cls,
        saved: Sequence[MapObject],
        rule: AssociationRule | None = None,
        before: "FloorMap | None" = None,
        merged: Mapping[str, str] | None = None,
    ) -> "FloorMap":
        """A map that holds an earlier one's objects, which stay as they are until they are seen again.

        before, merged: the map that this run has made so far and what its ids became, where it had to find its place.
        Raises MapError for an id given twice.
        """
        floor_map = cls.after(saved, rule)
        if len({item.id for item in saved}) < len(saved):
            raise MapError(f"{len(saved)} objects share {len({item.id for item in saved})} ids: the map is damaged")
        if before is not None:
            floor_map._issued |= before._issued
            floor_map.merged = {old: (merged or {}).get(new, new) for old, new in before.merged.items()}
            floor_map.merged |= {old: new for old, new in (merged or {}).items() if old != new}
        for number, item in enumerate(saved):
            systematic_m = floor_map.rule.systematic_of(max(footprint_m(item.label, item.width_m)))
            pool = ObservationPool.of_saved(number, item, systematic_m, floor_map.rule.correlated)
            floor_map._index(item.label).add(pool)
            floor_map._objects[item.id] = floor_map._owner[pool] = _Object(item.id, item.label, [pool])
            floor_map._change(item.id)
        return floor_map

    def update(self, sightings: list[PlacedSighting]) -> list[str]:
        """Take in all sightings of one frame; the id of each one's object."""
        self._frames += 1
        ids = [""] * len(sightings)
        for label in dict.fromkeys(placed.label for placed in sightings):
            rows = [row for row, placed in enumerate(sightings) if placed.label == label]
            for row, identity in zip(rows, self._update_label(label, [sightings[r] for r in rows]), strict=True):
                ids[row] = identity
        self._associate_pending()
        if self._frames % self.rule.forget_after == 0:
            self._forget()
        return ids

    def objects(self) -> list[MapObject]:
        """Objects with enough evidence, one in each place, ordered by id."""
        self._refresh()
        if self._listed is None:
            self._listed = self._ordered.copy()
        return self._listed

    def near(self, point_m: Array, reach_m: float) -> list[MapObject]:
        """Of `objects`, those no farther than that from a point (2,)."""
        self._refresh()
        found = [item.id for item in self._overlaps.within(point_m, reach_m) if item.id in self._shown]
        return [self._shown[identity] for identity in sorted(found, key=id_order)]

    def shown_as(self, identity: str) -> str:
        """The id under which the map shows what was sighted as this object: its own, or that of the object in its
        place."""
        self._refresh()
        return self._overlaps.best(identity)

    def moved(self, correction: TrajectoryCorrection, landmarks: LandmarkCorrection | None = None) -> None:
        """Everything moves with the pose that it was seen from, or with the landmark that it turned out to be where
        poses of that time are dropped. What turns out to be one merges, and what turns out to be two parts, as when it
        is sighted: a bounded number of pools in each frame."""
        landmarks = landmarks or LandmarkCorrection()
        self._recognise(landmarks.of_track)
        for index in self._pools.values():
            pools = [pool for pool in index.pools if pool is not None and pool.key[2] != SAVED_SIDE]
            if not pools:
                continue
            rows, stamps = [pool.row for pool in pools], np.array([pool.anchor_s for pool in pools])
            before = index.place[:2, rows].T
            after = correction.moved_points(stamps, before)
            pose_m2 = correction.point_covariances(stamps, after)
            by_m = after - before
            for at, pool in enumerate(pools):
                if pool.anchor_s < landmarks.since_s and pool.landmark in landmarks.moves_m:
                    by_m[at] = landmarks.moves_m[pool.landmark]
            changed = np.abs(by_m).max(axis=1) > 0.0
            far = np.abs(by_m).max(axis=1) > self.rule.still_m
            for at in np.flatnonzero(changed).tolist():
                pool = pools[at]
                pool.move(by_m[at], pose_m2[at])
                index.set(pool.row)
                self._change(self._owner[pool].id)
                if far[at]:
                    self._pending[pool] = None
            move_views([pools[at] for at in np.flatnonzero(changed).tolist()], correction)
        self._associate_pending()

    def _recognise(self, landmarks: Mapping[int, int]) -> None:
        """Tracks turned out to be landmarks that were seen before, or not to be: their pools are those landmarks'."""
        self._landmarks = landmarks
        for index in self._pools.values():
            for pool in index.pools:
                if pool is not None and pool.landmark >= 0:
                    known = landmarks.get(pool.key[3], landmarks.get(pool.landmark, pool.landmark))
                    if known != pool.landmark:
                        pool.landmark = known
                        index.set(pool.row)
                        self._pending[pool] = None

    def set_presence(self, identity: str, probability: float) -> None:
        """Scale an object's confidence by how probably it still stands there."""
        item = self._objects.get(identity)
        if item is not None and item.presence != probability:
            item.presence = probability
            self._change(identity)

    def drop(self, identity: str) -> None:
        """Forget an object, whatever it was called; its id is not given again."""
        self._refresh()
        for candidate in self._overlaps.members.get(identity, ()):
            self._remove(candidate.id)

    def forget_run(self, kept: Collection[str]) -> None:
        """Forget all sightings so far, but those of an earlier map and of objects with these shown ids."""
        for item in [item for item in self._objects.values() if self.shown_as(item.id) not in kept]:
            for pool in [pool for pool in item.pools if pool.key[2] != SAVED_SIDE]:
                self._remove_pool(item, pool)
            if not item.pools:
                del self._objects[item.id]
            self._change(item.id)

    def _index(self, label: str) -> PoolIndex:
        if label not in self._pools:
            self._pools[label] = PoolIndex(self.rule)
        return self._pools[label]

    def _update_label(self, label: str, sightings: list[PlacedSighting]) -> list[str]:
        index, pools = self._index(label), []
        for key, placed in zip(keys_of(sightings), sightings, strict=True):
            known = index.row_of.get(key)
            pool = ObservationPool(key, placed.sighting.extent_m) if known is None else index.pool(known)
            pool.landmark = self._landmarks.get(placed.track, placed.track)
            pool.add(placed, self._frames)
            index.add(pool) if known is None else index.set(pool.row)
            pools.append(pool)
        changed = False
        for pool in pools:
            known = len(pool.beside)
            pool.beside.update(dict.fromkeys(other for other in pools if other is not pool))
            changed |= len(pool.beside) > known or pool not in self._owner
        changed |= sum(index.link(pool.row) for pool in pools) > 0
        if changed:
            self._associate(label, pools)
        else:
            for pool in pools:
                self._change(self._owner[pool].id)
                if pool.sums.count >= pool.due:
                    self._pending[pool] = None
        return [self._owner[pool].id for pool in pools]

    def _associate_pending(self) -> None:
        """Associate again some of what moved, or was only seen better."""
        for pool in list(self._pending)[: self.rule.budget]:
            if pool in self._pending:
                label = self._owner[pool].label
                own = [other for other in self._owner[pool].pools if other in self._pending]
                for other in own:
                    del self._pending[other]
                    self._pools[label].link(other.row)
                self._associate(label, own)

    def _associate(self, label: str, pools: list[ObservationPool]) -> None:
        """Decide again what is one object, for all that these pools are linked with."""
        index, rows = self._pools[label], {pool.row for pool in pools}
        affected = sorted(self._around(index, rows), key=lambda row: index.pool(row).key)
        before = {owner.id: owner for row in affected if (owner := self._owner.get(index.pool(row)))}
        groups = [[index.pool(row) for row in group] for group in self._groups(index, affected)]
        for pool in (pool for group in groups for pool in group):
            pool.due = math.ceil(pool.sums.count * self.rule.grown)
        groups.sort(key=lambda group: min((pool.sums.first_seen_s, pool.key) for pool in group))
        homes = self._homes(groups, list(before))
        for group, names in zip(groups, homes, strict=True):
            identity = names[0] if names else self._new_id(label)
            known = before.get(identity)
            if known is None or len(names) > 1 or known.pools != group or any(pool.row in rows for pool in group):
                presence = max((before[name].presence for name in names), default=1.0)
                known = self._objects[identity] = _Object(identity, label, group, presence)
                self._change(identity)
            for pool in group:
                self._owner[pool] = known
            self._bound(index, known)
        self._rename({name: names[0] for names in homes for name in names[1:]})

    def _around(self, index: PoolIndex, rows: Iterable[int]) -> set[int]:
        """All that is linked with these rows, and the rest of the objects that it is part of."""
        found, size = set(rows), 0
        while len(found) > size:
            size = len(found)
            owners = [owner for row in found if (owner := self._owner.get(index.pool(row)))]
            found.update(pool.row for owner in owners for pool in owner.pools)
            found = index.connected(found)
        return found

    def _groups(self, index: PoolIndex, rows: list[int]) -> list[list[int]]:
        """These rows as objects, each connected part by itself."""
        left, found = dict.fromkeys(rows), []
        while left:
            part = sorted(index.connected({next(iter(left))}), key=lambda row: index.pool(row).key)
            for row in part:
                del left[row]
            found += index.agglomerated(part)
        return found

    def _bound(self, index: PoolIndex, item: _Object) -> None:
        """Join the pools of an object that were not seen for longest, each with the nearest of the others."""
        while len(item.pools) > self.rule.maximum_pools:
            own = [pool for pool in item.pools if pool.saved is None]
            gone = min(own, key=lambda pool: (pool.updated, pool.key))
            others = [p for p in own if p is not gone and not p.is_apart(gone) and p.updated < self._frames]
            if not others:
                return
            here = index.place[:2, gone.row]
            near = [float(np.abs(index.place[:2, pool.row] - here).sum()) for pool in others]
            pair = gone, others[near.index(min(near))]
            kept, gone = sorted(pair, key=lambda pool: (-pool.weight, pool.key))  # with its time and its landmark
            if kept.landmark not in self._landmarks and gone.landmark != gone.key[3]:
                kept.landmark = gone.landmark
            index.join(kept.row, gone.row)
            item.pools.remove(gone)
            del self._owner[gone]
            self._pending.pop(gone, None)

    def _homes(self, groups: list[list[ObservationPool]], ids: list[str]) -> list[list[str]]:
        """For each group the ids that it goes on with, oldest first: an id goes where most of its sightings are."""
        shares: dict[str, Counter[int]] = {identity: Counter() for identity in ids}
        for number, group in enumerate(groups):
            for pool in group:
                if (owner := self._owner.get(pool)) is not None:
                    shares[owner.id][number] += pool.sums.count
        homes: list[list[str]] = [[] for _ in groups]
        for identity in sorted(ids, key=id_order):
            share = shares[identity]
            homes[min(share, key=lambda number: (-share[number], number))].append(identity)
        return homes

    def _new_id(self, label: str) -> str:
        self._issued[label] += 1
        return f"{label}-{self._issued[label]}"

    def _rename(self, renamed: dict[str, str]) -> None:
        """Ids that are no more, to those that they became."""
        if renamed:
            for old in renamed:
                del self._objects[old]
                self._change(old)
            merged = {old: renamed.get(new, new) for old, new in self.merged.items()} | renamed
            self.merged = dict(islice(merged.items(), max(len(merged) - MERGED_IDS, 0), None))

    def _forget(self) -> None:
        """Drop what never gathered enough evidence and has not been seen for long, so that a long drive stays quick."""
        since = self._frames - self.rule.forget_after
        self._refresh()
        for item in list(self._objects.values()):
            unseen = max(pool.updated for pool in item.pools) <= since
            if unseen and self._overlaps.best(item.id) not in self._shown:
                self._remove(item.id)

    def _remove(self, identity: str) -> None:
        item = self._objects.pop(identity)
        for pool in list(item.pools):
            self._remove_pool(item, pool)
        self._change(identity)

    def _remove_pool(self, item: _Object, pool: ObservationPool) -> None:
        item.pools.remove(pool)
        self._pools[item.label].remove(pool.row)
        del self._owner[pool]
        self._pending.pop(pool, None)

    def _change(self, identity: str) -> None:
        self._changed[identity] = None
        if (item := self._objects.get(identity)) is not None:
            item.estimate = None

    def _refresh(self) -> None:
        """What the map shows, for all that changed since it was last asked for."""
        if not self._changed:
            return
        for identity in self._changed:
            item = self._objects.get(identity)
            if item is None:
                self._overlaps.remove(identity)
            else:
                own = item.estimated(self.rule)
                width_m, evidence = own.sums.width_m / own.sums.count, own.sums.weight * own.sums.confidence
                self._overlaps.set(Candidate(identity, item.label, own.position_m, width_m, evidence))
        self._changed = {}
        for identity in self._overlaps.settle():
            members = self._overlaps.members.get(identity)
            self._show(identity, self._as_map_object(members) if members else None)
        self._listed = None

    def _show(self, identity: str, shown: MapObject | None) -> None:
        """Show an object, or no longer, in its place in the order: a large map is not sorted again."""
        key = id_order(identity), identity
        at, known = bisect_left(self._order, key), identity in self._shown
        if shown is None and known:
            del self._shown[identity], self._order[at], self._ordered[at]
        elif shown is not None:
            self._shown[identity] = shown
            self._order[at : at + known], self._ordered[at : at + known] = [key], [shown]

    def _as_map_object(self, members: list[Candidate]) -> MapObject | None:
        """Candidates in one place as one object; None where they have not enough evidence together."""
        items = [self._objects[candidate.id] for candidate in members]
        best, estimates = items[0], [item.estimated(self.rule) for item in items]
        named: dict[str, float] = defaultdict(float)
        for item, own in zip(items, estimates, strict=True):
            named[item.label] += own.sums.weight
        others = [own.sums for item, own in zip(items[1:], estimates[1:], strict=True) if item.label != best.label]
        estimate = estimates[0]
        if not estimate.shows(others):
            return None
        labels = label_posterior(named, self._overlaps.rule)
        if estimate.saved is not None and len(best.pools) == 1:  # not seen since
            confidence = estimate.saved.confidence * best.presence
            return replace(estimate.saved, confidence=confidence, labels=estimate.saved.labels or labels)
        plain = estimate.as_object(best.id, best.label)
        views = sorted(set[tuple[int, int]]().union(*(pool.views for pool in best.pools)))
        places = outermost([((i + 0.5) * VIEW_M, (j + 0.5) * VIEW_M) for i, j in views], plain.position_m)
        return replace(plain, confidence=plain.confidence * best.presence, seen_from_m=places, labels=labels)
