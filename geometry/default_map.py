"""The default clustering: each sighting goes to the object that it fits best, under both covariances.

Two boxes of one frame never become one object, so chairs that stand closer than the paper's 1 m stay apart. Objects
that turn out to be one (close, and never seen side by side) merge, and the older id stays.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from edgemap.geometry.association import AssociationRule, Estimate, assign, may_merge
from edgemap.geometry.errors import MapError
from edgemap.geometry.exclusion import without_overlaps
from edgemap.geometry.floor_map import MapObject, id_order
from edgemap.geometry.sighting import PlacedSighting

Array = NDArray[np.float64]


VIEW_M = 0.5  # side of the squares in which places that an object was seen from are remembered


@dataclass(slots=True)
class _Object:
    """together: ids of objects seen beside it in one frame. updated: number of the last frame that saw it. views:
    squares that it was seen from. most: confidence that it may show."""

    id: str
    estimate: Estimate
    updated: int
    together: set[str] = field(default_factory=set)
    shown: MapObject | None = None
    views: set[tuple[int, int]] = field(default_factory=set)
    most: float = 1.0

    def as_map_object(self, label: str, rule: AssociationRule) -> MapObject:
        """The object as the map shows it."""
        estimate = self.estimate
        plain = estimate.sums.as_object(self.id, label, estimate.position_m, estimate.covariance(rule))
        places = tuple(((i + 0.5) * VIEW_M, (j + 0.5) * VIEW_M) for i, j in sorted(self.views))
        return replace(plain, confidence=min(plain.confidence, self.most), seen_from_m=places)


def _square(place_m: Sequence[float] | Array) -> tuple[int, int]:
    return math.floor(place_m[0] / VIEW_M), math.floor(place_m[1] / VIEW_M)


class _Class:
    """The objects of one label, with their positions side by side so that few of them need a closer look."""

    def __init__(self) -> None:
        self.objects: list[_Object] = []
        self._positions_m = np.zeros((0, 2))

    def near(self, position_m: Array, reach_m: float) -> list[int]:
        """Rows of the objects within reach of a position (2,)."""
        offsets = self._positions_m - position_m
        return np.flatnonzero((offsets**2).sum(axis=1) <= reach_m**2).tolist()

    def append(self, item: _Object) -> None:
        """Add an object."""
        self.objects.append(item)
        self._positions_m = np.vstack([self._positions_m, item.estimate.position_m])

    def moved(self, row: int) -> None:
        """Take note that an object's estimate has changed."""
        self._positions_m[row] = self.objects[row].estimate.position_m
        self.objects[row].shown = None

    def keep(self, wanted: list[bool]) -> None:
        """Drop the objects that are not wanted."""
        if not all(wanted):
            self.objects = [item for item, stays in zip(self.objects, wanted, strict=True) if stays]
            self._positions_m = self._positions_m[np.array(wanted, dtype=bool)]


class FloorMap:
    """Objects by association, fed frame by frame; deterministic ids such as `chair-3` in order of appearance."""

    def __init__(self, rule: AssociationRule | None = None) -> None:
        self.rule = rule or AssociationRule()
        self._classes: dict[str, _Class] = {}
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
        for item in saved:
            kind = floor_map._classes.setdefault(item.label, _Class())
            known = _Object(item.id, Estimate.of_saved(item, floor_map.rule), 0, shown=item)
            known.views = {_square(place) for place in item.seen_from_m}
            for other in kind.objects:  # the earlier map has told them apart
                other.together.add(known.id)
                known.together.add(other.id)
            kind.append(known)
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
        found = []
        for label, kind in self._classes.items():
            for item in kind.objects:
                if item.shown is None and item.estimate.shows(self.rule):
                    item.shown = item.as_map_object(label, self.rule)
                if item.shown is not None:
                    found.append(item.shown)
        return without_overlaps(sorted(found, key=lambda item: id_order(item.id)))

    def doubt(self, identity: str, most: float) -> None:
        """Show an object with this confidence at most."""
        for kind in self._classes.values():
            for item in kind.objects:
                if item.id == identity and item.most != most:
                    item.most, item.shown = most, None

    def drop(self, identity: str) -> None:
        """Forget an object; its id is not given again."""
        for kind in self._classes.values():
            kind.keep([item.id != identity for item in kind.objects])

    def _update_label(self, label: str, sightings: list[PlacedSighting]) -> list[str]:
        kind = self._classes.setdefault(label, _Class())
        seen: list[_Object] = []
        for placed, row in zip(sightings, self._match(sightings, kind), strict=True):
            if row is None:
                self._issued[label] += 1
                item = _Object(f"{label}-{self._issued[label]}", Estimate(placed), self._frames)
                kind.append(item)
            else:
                item = kind.objects[row]
                item.estimate.add(placed)
                item.updated = self._frames
                kind.moved(row)
            item.views.add(_square(placed.position_map_m - placed.lever_m))
            seen.append(item)
        for item in seen:
            item.together.update(other.id for other in seen if other is not item)
        renamed = self._merge(kind, seen)
        return [renamed.get(item.id, item.id) for item in seen]

    def _match(self, sightings: list[PlacedSighting], kind: _Class) -> list[int | None]:
        """For each sighting the row of the object it belongs to, or None."""
        near = {row for placed in sightings for row in kind.near(placed.position_map_m, self.rule.max_distance_m)}
        rows = sorted(near)
        matches = assign(sightings, [kind.objects[row].estimate for row in rows], self.rule)
        return [None if match is None else rows[match] for match in matches]

    def _merge(self, kind: _Class, seen: list[_Object]) -> dict[str, str]:
        """Join every object seen now with others of its label that are the same thing; old id to new id."""
        renamed: dict[str, str] = {}
        gone: set[str] = set()
        for item in seen:
            reach_m = max(self.rule.merge_distance_m, self.rule.merge_extent_share * item.estimate.extent_m)
            for row in kind.near(item.estimate.position_m, reach_m):
                other = kind.objects[row]
                if other is item or item.id in gone or other.id in gone or not self._same(item, other):
                    continue
                older, younger = sorted((item, other), key=lambda o: id_order(o.id))
                older.estimate.join(younger.estimate)
                older.together |= younger.together
                older.views |= younger.views
                older.most = max(older.most, younger.most)
                older.updated = max(older.updated, younger.updated)
                gone.add(younger.id)
                renamed[younger.id] = older.id
                kind.moved(kind.objects.index(older))
        if renamed:
            kind.keep([item.id not in gone for item in kind.objects])
            for old, new in list(renamed.items()):
                while new in renamed:
                    new = renamed[new]
                renamed[old] = new
            self.merged = {old: renamed.get(new, new) for old, new in self.merged.items()} | renamed
            for item in kind.objects:
                item.together = {renamed.get(identity, identity) for identity in item.together} - {item.id}
        return renamed

    def _same(self, a: _Object, b: _Object) -> bool:
        beside = b.id in a.together or a.id in b.together
        return not beside and may_merge(a.estimate, b.estimate, self.rule)

    def _forget(self) -> None:
        """Drop what never gathered enough evidence and has not been seen for long, so that a long drive stays quick."""
        for kind in self._classes.values():
            kind.keep(
                [
                    item.estimate.shows(self.rule) or self._frames - item.updated < self.rule.forget_after
                    for item in kind.objects
                ]
            )
