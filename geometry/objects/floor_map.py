"""The default clustering: sightings that are the same thing under both covariances, whatever their order.

Two boxes of one frame never become one object, so chairs that stand closer than the paper's 1 m stay apart. What is one
object is decided anew, for all that hangs together with a frame's sightings, from the pools that all sightings ever
went into: the map is the one that its batch version makes of all frames at once. Objects that turn out to be one merge,
and the older id stays; the larger part of one that turns out to be two keeps its id.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from edgemap.geometry.errors import MapError
from edgemap.geometry.objects.association import AssociationRule, Estimate, Positions, agglomerated
from edgemap.geometry.objects.footprints import footprint_m
from edgemap.geometry.objects.map_object import MapObject, id_order
from edgemap.geometry.objects.observation_pool import VIEW_M, Key, ObjectShift, ObservationPool, keys_of
from edgemap.geometry.objects.overlap_suppression import without_overlaps
from edgemap.geometry.observations.sighting import PlacedSighting

Array = NDArray[np.float64]


@dataclass(slots=True, eq=False)
class _Object:
    """pools: the evidence that it is made of. shows, shown: None until asked for. most: confidence that it may show."""

    id: str
    label: str
    pools: list[ObservationPool]
    most: float = 1.0
    shows: bool | None = None
    shown: MapObject | None = None

    def settled(self, rule: AssociationRule) -> MapObject | None:
        """The object as the map shows it, None where there is not enough evidence."""
        if self.shows is None:
            estimate = Estimate(self.pools, rule)
            self.shows = estimate.shows
            if self.shows:
                self.shown = self._as_map_object(estimate)
        return self.shown

    def _as_map_object(self, estimate: Estimate) -> MapObject:
        if estimate.saved is not None and len(self.pools) == 1:  # not seen since
            return replace(estimate.saved, confidence=min(estimate.saved.confidence, self.most))
        plain = estimate.as_object(self.id, self.label)
        views = sorted(set[tuple[int, int]]().union(*(pool.views for pool in self.pools)))
        places = tuple(((i + 0.5) * VIEW_M, (j + 0.5) * VIEW_M) for i, j in views)
        return replace(plain, confidence=min(plain.confidence, self.most), seen_from_m=places)


class _Class:
    """The pools of one label, row by row, and the object that each is part of.

    links: rows that each may join. region: number of the neighbourhood that each was settled with.
    """

    def __init__(self, rule: AssociationRule) -> None:
        self.rule = rule
        self.pools: list[ObservationPool] = []
        self.row_of: dict[Key, int] = {}
        self.links: list[set[int]] = []
        self.owner: list[_Object | None] = []
        self.region: list[int] = []
        self.places = Positions(rule)

    def append(self, pool: ObservationPool, owner: _Object | None = None) -> int:
        """Add a pool; its row."""
        self.row_of[pool.key] = len(self.pools)
        self.pools.append(pool)
        self.links.append(set())
        self.owner.append(owner)
        self.region.append(-1)
        return self.places.append(pool)

    def add(self, key: Key, placed: PlacedSighting, frame: int) -> int:
        """Take in a sighting; its pool's row."""
        row = self.row_of.get(key)
        pool = ObservationPool(key, placed.sighting.extent_m) if row is None else self.pools[row]
        pool.add(placed, frame)
        if row is None:
            return self.append(pool)
        self.places.set(row, pool)
        return row

    def link(self, row: int) -> None:
        """Find anew what a pool may join."""
        near = np.flatnonzero(self.places.distances(slice(row, row + 1))[0] < np.inf).tolist()
        now = {other for other in near if self.pools[other].key not in self.pools[row].beside}
        for other in self.links[row] - now:
            self.links[other].discard(row)
        for other in now - self.links[row]:
            self.links[other].add(row)
        self.links[row] = now

    def around(self, rows: Iterable[int]) -> list[int]:
        """What hangs together with these rows, or did when it was settled last, in the order of their keys."""
        found, size = set(rows), 0
        while len(found) > size:
            size = len(found)
            regions = {self.region[row] for row in found} - {-1}
            found.update(row for row, region in enumerate(self.region) if region in regions)
            found = self._linked(found)
        return sorted(found, key=lambda row: self.pools[row].key)

    def groups(self, rows: list[int]) -> list[list[int]]:
        """These rows as objects, each neighbourhood by itself; takes note of the neighbourhoods."""
        left, found = dict.fromkeys(rows), []
        while left:
            first = next(iter(left))
            part = sorted(self._linked({first}), key=lambda row: self.pools[row].key)
            for row in part:
                del left[row]
                self.region[row] = first
            groups = agglomerated(self.places.chosen(part), [self.pools[row] for row in part])
            found += [[part[member] for member in group] for group in groups]
        return found

    def without(self, gone: set[str]) -> _Class:
        """The same without some objects, by id."""
        kept = _Class(self.rule)
        for pool, owner in zip(self.pools, self.owner, strict=True):
            if owner is not None and owner.id not in gone:
                kept.append(pool, owner)
        for row in range(len(kept.pools)):
            kept.link(row)
            kept.region[row] = self.region[self.row_of[kept.pools[row].key]]
        return kept

    def rekeyed(self, part_of: Mapping[int, int]) -> _Class:
        """The same after pools were moved: those of one object that came to lie on one spot are one.

        part_of: what a pool's thing turned out to be.
        """
        parts: dict[Key, list[int]] = {}
        for row, pool in enumerate(self.pools):
            thing, rank = part_of.get(pool.thing, pool.thing), 0
            while not self._fits(row, parts.get(pool.key_here(thing, rank), [])):
                rank += 1
            parts.setdefault(pool.key_here(thing, rank), []).append(row)
        became = {self.pools[row].key: key for key, rows in parts.items() for row in rows}
        kept = _Class(self.rule)
        for key, rows in parts.items():
            whole = self.pools[rows[0]]
            for row in rows[1:]:
                whole.join(self.pools[row])
            whole.key, whole.beside = key, {became[other] for other in whole.beside if other in became}
            kept.append(whole, self.owner[rows[0]])
        for row in range(len(kept.pools)):
            kept.link(row)
        return kept

    def _fits(self, row: int, others: list[int]) -> bool:
        """Whether a pool may become one with these: one object's, and never seen side by side."""
        beside = self.pools[row].beside
        return all(self.owner[other] is self.owner[row] and self.pools[other].key not in beside for other in others)

    def _linked(self, rows: set[int]) -> set[int]:
        found, new = set(rows), set(rows)
        while new:
            new = set[int]().union(*(self.links[row] for row in new)) - found
            found |= new
        return found


class FloorMap:
    """Objects by association, fed frame by frame; deterministic ids such as `chair-3` in order of appearance."""

    movable = True

    def __init__(self, rule: AssociationRule | None = None) -> None:
        self.rule = rule or AssociationRule()
        self._classes: dict[str, _Class] = {}
        self._objects: dict[str, _Object] = {}
        self._issued: Counter[str] = Counter()
        self._frames = 0
        self.merged: dict[str, str] = {}

    @classmethod
    def after(cls, saved: Sequence[MapObject], rule: AssociationRule | None = None) -> FloorMap:
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
        before: FloorMap | None = None,
        merged: Mapping[str, str] | None = None,
    ) -> FloorMap:
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
            kind = floor_map._classes.setdefault(item.label, _Class(floor_map.rule))
            systematic_m = floor_map.rule.systematic_of(max(footprint_m(item.label, item.width_m)))
            pool = ObservationPool.of_saved(number, item, systematic_m, floor_map.rule.correlated)
            item_now = floor_map._objects[item.id] = _Object(item.id, item.label, [pool])
            kind.append(pool, item_now)
        for kind in floor_map._classes.values():
            for pool in kind.pools:  # the earlier map has told them apart
                pool.beside.update(key for key in kind.row_of if key != pool.key)
        return floor_map

    def update(self, sightings: list[PlacedSighting]) -> list[str]:
        """Take in all sightings of one frame; the id of each one's object."""
        self._frames += 1
        ids = [""] * len(sightings)
        for label in dict.fromkeys(placed.label for placed in sightings):
            rows = [row for row, placed in enumerate(sightings) if placed.label == label]
            for row, identity in zip(rows, self._update_label(label, [sightings[r] for r in rows]), strict=True):
                ids[row] = identity
        if self._frames % self.rule.forget_after == 0:
            self._forget()
        return ids

    def objects(self) -> list[MapObject]:
        """Objects with enough evidence, none in the place of a better one, ordered by id."""
        found = [shown for item in self._objects.values() if (shown := item.settled(self.rule)) is not None]
        return without_overlaps(sorted(found, key=lambda item: id_order(item.id)))

    def moved(self, things: Mapping[int, ObjectShift]) -> None:
        """What was seen of some things lies elsewhere than thought, by the thing's number. What turns out to be one
        merges, and what turns out to be two parts, as when it is sighted."""
        for label, kind in list(self._classes.items()):
            there = [pool for pool in kind.pools if pool.thing in things]
            for pool in there:
                pool.move(things[pool.thing].by_m, things[pool.thing].from_way_m2)
            if there:
                kind = self._classes[label] = kind.rekeyed({number: move.part_of for number, move in things.items()})
                self._settle(label, kind, list(range(len(kind.pools))))

    def doubt(self, identity: str, most: float) -> None:
        """Show an object with this confidence at most."""
        item = self._objects.get(identity)
        if item is not None and item.most != most:
            item.most, item.shows = most, None

    def drop(self, identity: str) -> None:
        """Forget an object; its id is not given again."""
        item = self._objects.pop(identity, None)
        if item is not None:
            self._classes[item.label] = self._classes[item.label].without({identity})

    def _update_label(self, label: str, sightings: list[PlacedSighting]) -> list[str]:
        kind = self._classes.setdefault(label, _Class(self.rule))
        keys = keys_of(sightings)
        rows = [kind.add(key, placed, self._frames) for key, placed in zip(keys, sightings, strict=True)]
        for row in rows:
            kind.pools[row].beside.update(key for key in keys if key != kind.pools[row].key)
        for row in rows:
            kind.link(row)
        self._settle(label, kind, rows)
        return [owner.id for row in rows if (owner := kind.owner[row]) is not None]

    def _settle(self, label: str, kind: _Class, rows: list[int]) -> None:
        """Decide anew what is one object, for all that these rows hang together with."""
        affected = kind.around(rows)
        before = {owner.id: owner for row in affected if (owner := kind.owner[row]) is not None}
        groups = kind.groups(affected)
        groups.sort(key=lambda group: min((kind.pools[row].sums.first_seen_s, kind.pools[row].key) for row in group))
        homes = self._homes(kind, groups, list(before))
        for group, names in zip(groups, homes, strict=True):
            identity = names[0] if names else self._new_id(label)
            pools = [kind.pools[row] for row in group]
            known = before.get(identity)
            if known is None or len(names) > 1 or known.pools != pools or {*group} & {*rows}:
                most = max((before[name].most for name in names), default=1.0)
                known = _Object(identity, label, pools, most)
            self._objects[identity] = known
            for row in group:
                kind.owner[row] = known
        self._rename({name: names[0] for names in homes for name in names[1:]})

    def _homes(self, kind: _Class, groups: list[list[int]], ids: list[str]) -> list[list[str]]:
        """For each group the ids that it goes on with, oldest first: an id goes where most of its sightings are."""
        group_of = {row: number for number, group in enumerate(groups) for row in group}
        shares: dict[str, Counter[int]] = {identity: Counter() for identity in ids}
        for row, number in group_of.items():
            owner = kind.owner[row]
            if owner is not None:
                shares[owner.id][number] += kind.pools[row].sums.count
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
            self.merged = {old: renamed.get(new, new) for old, new in self.merged.items()} | renamed

    def _forget(self) -> None:
        """Drop what never gathered enough evidence and has not been seen for long, so that a long drive stays quick."""
        since = self._frames - self.rule.forget_after
        weak = {
            item.id
            for item in self._objects.values()
            if max(pool.updated for pool in item.pools) <= since and item.settled(self.rule) is None
        }
        for label, kind in self._classes.items():
            self._classes[label] = kind.without(weak)
        for identity in weak:
            del self._objects[identity]
