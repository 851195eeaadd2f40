"""What a map keeps besides its objects' positions: its identity, wall times, and each object's history.

It is derived from what the map shows after each step; the measured map does not depend on it.
"""

import hashlib
import math
import uuid
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from edgemap.geometry.arrays import CHI2_997, positive
from edgemap.geometry.grid.occupancy_grid import FREE, OccupancyGrid
from edgemap.geometry.grid.rooms import Door, Room
from edgemap.geometry.map_object import CHI2_95, MapEvent, MapObject, radius_m
from edgemap.geometry.objects.annotations import Annotations, MapIdentity
from edgemap.geometry.objects.candidates import least_spacing_m
from edgemap.geometry.objects.events import Edit
from edgemap.geometry.observations.class_extents import extent_m
from edgemap.geometry.slam.object_landmarks import LandmarkRule
from edgemap.runtime.step.relocalisation import SavedMap
from edgemap.runtime.step.wall_clock import WallClock

MOVED_M = 0.25  # a shorter way is no move: estimates settle by as much
MAXIMUM_EVENTS = 20  # of an object: the first and the latest
MAXIMUM_VANISHED = 100  # objects that are remembered after they are gone
BY_PEOPLE = {"name": "named", "confirm": "confirmed", "correct": "corrected", "add": "added", "merge": "merged"}


class MapMemory:
    """Annotates what a map shows. clock: of the stream's stamps. identity: of the map; a new one until a saved map is
    entered."""

    def __init__(self) -> None:
        self.clock, self.identity = WallClock(), MapIdentity(str(uuid.uuid4()))
        self._stamp_s = 0.0
        self._earlier: dict[str, MapObject] = {}  # of the saved map, by today's ids
        self._floor: OccupancyGrid | None = None  # of the saved map
        self._floor_now: OccupancyGrid | None = None
        self._sighted: dict[str, tuple[float, float]] = {}  # first and last stamp in this run
        self._events: dict[str, list[tuple[float, MapEvent]]] = {}  # of this run, at stamps
        self._standing: dict[str, MapObject] = {}  # shown last, where each was when it last moved
        self._vanished: dict[str, MapObject] = {}
        self._areas: tuple[tuple[Room, ...], tuple[Door, ...]] = (), ()  # of the saved map
        self._moved_from: dict[str, str] = {}  # ids of this run's objects, to those that they were in the saved map
        self._shown: dict[str, tuple[tuple[object, ...], MapObject]] = {}

    def enter(self, saved: SavedMap, became: Mapping[str, str]) -> None:
        """A saved map goes on. became: new ids of this run's objects so far, which were in a separate frame."""
        annotations = saved.annotations
        self.identity = annotations.identity.next() if annotations.identity else self.identity
        self._earlier, self._floor = {item.id: item for item in saved.objects}, saved.grid
        self._vanished = {item.id: item for item in annotations.vanished}
        self._areas = annotations.rooms, annotations.doors
        events, self._events = self._events, {}
        for old, name in became.items():
            if name not in self._earlier:
                self._events |= {name: events[old]} if old in events else {}
            elif old in self._shown:
                item = self._shown[old][1]
                self._extend(name, (item.first_seen_s, item.last_seen_s))
        self._standing = dict(self._earlier)
        for identity in self._sighted:
            self._add(identity, MapEvent("restored"))

    def identify(self, first: bytes) -> None:
        """A new map takes its id from the first picture: replays of a recording make the same map."""
        if self.identity.generation == 1:
            self.identity = MapIdentity(str(uuid.uuid5(uuid.NAMESPACE_OID, hashlib.sha256(first).hexdigest())))

    def begin(self, stamp_s: float, floor: OccupancyGrid | None = None) -> None:
        """A step begins. floor: as observed so far."""
        self._stamp_s, self._floor_now = stamp_s, floor

    def sighted(self, object_ids: Iterable[str]) -> None:
        """The objects that this step has observed."""
        for identity in self._earlier.keys() & set(object_ids):
            if identity not in self._sighted:
                self._add(identity, MapEvent("restored"))
            self._extend(identity, (self._stamp_s, self._stamp_s))

    def edited(self, edit: Edit, identity: str) -> None:
        """A person has edited an object."""
        if what := BY_PEOPLE.get(edit.do):
            merged = edit.do == "merge"
            event = MapEvent(what, by="person", to_m=edit.place_m, other=edit.id if merged else "")  # pyright: ignore[reportArgumentType]
            self._add(edit.into if merged else identity, event)

    def missed(self, ids: Iterable[str]) -> None:
        """Objects that a person has named or confirmed and that are not in their place."""
        for identity in ids:
            if not any(event.what == "missed" for _, event in self._events.get(identity, ())):
                self._add(identity, MapEvent("missed"))

    def corrected(self) -> None:
        """A loop closure has moved what this run has mapped: nothing of it has moved in the world."""
        for identity in self._standing.keys() - self._earlier.keys():
            del self._standing[identity]

    def annotated(
        self, objects: Sequence[MapObject], merged: Mapping[str, str], deleted: Iterable[MapObject] = ()
    ) -> list[MapObject]:
        """The objects with wall times and history, after noting what has changed since the last call. merged: retired
        ids, with those that they became part of. deleted: by a person."""
        self._compare(objects, merged, {item.id for item in deleted})
        return [self._annotated(item) for item in objects]

    def annotations(self, annotations: Annotations) -> Annotations:
        """A map's annotations with its identity and what has vanished."""
        gone = (self._annotated(item) if item.id in self._events else item for item in self._vanished.values())
        (rooms, doors), named = self._areas, {room.id for room in annotations.rooms}
        rooms = (*annotations.rooms, *(room for room in rooms if room.id not in named))
        return replace(annotations, rooms=rooms, doors=doors, identity=self.identity, vanished=tuple(gone))

    def _extend(self, identity: str, stamps_s: tuple[float, float]) -> None:
        first_s, last_s = self._sighted.get(identity, stamps_s)
        self._sighted[identity] = min(first_s, stamps_s[0]), max(last_s, stamps_s[1])

    def _add(self, identity: str, event: MapEvent) -> None:
        self._events.setdefault(identity, []).append((self._stamp_s, event))

    def _compare(self, objects: Sequence[MapObject], merged: Mapping[str, str], deleted: set[str]) -> None:
        """Notes what has appeared, vanished or moved."""
        now = {item.id: item for item in objects}
        for identity in self._standing.keys() - now.keys():
            item = self._standing.pop(identity)
            into = merged.get(identity) or self._heir(item, objects)
            self._leave(item, now.get(into or ""), identity in deleted or into is not None)
        for identity, item in now.items():
            stood = self._standing.get(identity)
            if stood is None:
                self._standing[identity] = item
                self._come(item)
            elif _has_moved(stood, item):
                self._standing[identity] = item
                self._add(identity, MapEvent("moved", from_m=stood.place_m, to_m=item.place_m))
        self._confirm()
        self._link(now)

    def _confirm(self) -> None:
        """What was missed has vanished, once the floor is seen to be free there."""
        for item in list(self._vanished.values()):
            events = self._events.get(item.id, ())
            if events and events[-1][1].what == "missed" and _is_free(self._floor_now, item):
                events[-1] = events[-1][0], replace(events[-1][1], what="vanished")
                self._shown.pop(item.id, None)
                self._vanished[item.id] = self._annotated(item)

    def _come(self, item: MapObject) -> None:
        """An object is shown that was not before."""
        self._vanished.pop(item.id, None)
        for new in [new for new, old in self._moved_from.items() if old == item.id]:  # it has not moved
            del self._moved_from[new], self._earlier[new], self._sighted[new]
            for row, (stamp_s, event) in enumerate(self._events.get(new, ())):
                if event.what == "moved" and event.other:
                    self._events[new][row] = stamp_s, MapEvent("appeared", to_m=event.to_m)
        events = [one for one in self._events.pop(item.id, []) if one[1].what not in ("vanished", "missed")]
        if events:
            self._events[item.id] = events
        elif item.id not in self._earlier:
            self._events[item.id] = [(item.first_seen_s, MapEvent("appeared", to_m=item.place_m))]

    def _heir(self, item: MapObject, objects: Sequence[MapObject]) -> str | None:
        """The id of a new object of a class that stands where one has left: it is that one."""
        kin = [one for one in objects if one.label == item.label and one.id not in self._earlier]
        near = [one for one in kin if math.dist(one.place_m, item.place_m) < least_spacing_m(one, item)]
        return min(near, key=lambda one: math.dist(one.place_m, item.place_m)).id if near else None

    def _leave(self, item: MapObject, into: MapObject | None, explained: bool) -> None:
        """An object is no longer shown. into: of which it has become part. explained: by that, or a person's edit."""
        if into is not None:
            if item.id in self._earlier and into.id not in self._earlier:
                self._earlier[into.id] = replace(self._earlier[item.id], id=into.id)
                self._events[into.id] = [(self._stamp_s, MapEvent("restored"))]
                self._extend(into.id, (into.first_seen_s, into.last_seen_s))
            if item.id in self._sighted:
                self._extend(into.id, self._sighted[item.id])
        elif not explained:
            self._add(item.id, MapEvent("missed", from_m=item.place_m))  # or vanished, see `_confirm`
            self._vanished[item.id] = self._annotated(item)
            for oldest in list(self._vanished)[:-MAXIMUM_VANISHED]:
                del self._vanished[oldest]
                self._events.pop(oldest, None)
        self._shown.pop(item.id, None)

    def _link(self, now: Mapping[str, MapObject]) -> None:
        """Finds objects that were moved between runs: of a class, one of the saved map has vanished, all others were
        observed again, and one is new, where the saved map shows free floor."""
        gone = [one for one in self._vanished.values() if one.id in self._earlier and one.id not in now]
        gone = [one for one in gone if one.history[-1].what == "vanished"]
        for old in gone:
            kin = [item for item in now.values() if item.label == old.label]
            new = [item for item in kin if item.id not in self._earlier]
            accounted = all(item.id in self._sighted for item in kin if item.id in self._earlier)
            alone = sum(one.label == old.label for one in gone) == 1
            if alone and len(new) == 1 and accounted and _is_free(self._floor, new[0]):
                moved = MapEvent("moved", from_m=old.place_m, to_m=new[0].place_m, other=old.id)
                self._moved_from[new[0].id] = old.id
                self._extend(new[0].id, (new[0].first_seen_s, new[0].last_seen_s))
                self._earlier[new[0].id] = replace(self._earlier[old.id], id=new[0].id)
                self._events[new[0].id] = [(new[0].first_seen_s, moved)]
                del self._vanished[old.id]

    def _annotated(self, item: MapObject) -> MapObject:
        earlier, stamps_s = self._earlier.get(item.id), self._sighted.get(item.id)
        events, utc = self._events.get(item.id, []), self.clock.utc
        first_s, last_s = item.first_seen_s, max(item.last_seen_s, stamps_s[1] if stamps_s else -math.inf)
        if earlier is not None and stamps_s is not None:
            first_s, last_s = stamps_s
        key = (item, first_s, last_s, len(events), utc(last_s), earlier)
        if (shown := self._shown.get(item.id)) and shown[0] == key:
            return shown[1]
        first, last, since, before = utc(first_s), utc(last_s), utc(first_s), tuple[MapEvent, ...]()
        if earlier is not None:
            first, before = earlier.first_seen, earlier.history
            last = last if stamps_s else earlier.last_seen
            if stamps_s is None or not earlier.earlier:  # else the run before has not observed it in its place
                since = earlier.since
            if stamps_s is not None and not _is_in_place(earlier, item):
                since = None
        since = next((utc(stamp_s) for stamp_s, event in reversed(events) if event.what == "moved"), since)
        annotated = replace(
            item, first_seen_s=first_s, last_seen_s=last_s, first_seen=first, last_seen=last, since=since,
            history=_bounded(before, [replace(event, at=utc(stamp_s)) for stamp_s, event in events]),
            earlier=earlier is not None and stamps_s is None,
        )  # fmt: skip
        self._shown[item.id] = key, annotated
        return annotated


def _bounded(before: tuple[MapEvent, ...], events: Sequence[MapEvent]) -> tuple[MapEvent, ...]:
    """Both, with one `restored` at most, the latest."""
    if any(event.what == "restored" for event in events):
        before = tuple(event for event in before if event.what != "restored")
    history = (*before, *events)
    return history if len(history) <= MAXIMUM_EVENTS else (history[0], *history[1 - MAXIMUM_EVENTS :])


def _is_free(floor: OccupancyGrid | None, item: MapObject) -> bool:
    """Whether the floor was observed to be free where an object stands or stood."""
    if floor is None:
        return False
    turns, r_m = np.linspace(0.0, math.tau, 8, endpoint=False), 0.7 * radius_m(item)
    points_m = item.position_m + np.vstack([np.zeros(2), r_m * np.column_stack([np.cos(turns), np.sin(turns)])])
    return float(np.mean(floor.at(points_m) == FREE)) >= 0.8  # a cell at its rim may be another object's


def _is_in_place(saved: MapObject, item: MapObject) -> bool:
    """Whether a later run has observed an object where the saved map has it (95 %), rather than another one near: its
    observations shift the estimate by the covariance that they take from it, or where the object's footprint is."""
    shift_m, least_m2 = item.position_m - saved.position_m, LandmarkRule().centre_m2(extent_m(item.label, item.width_m))
    gained_m2 = positive(saved.covariance_m2 - item.covariance_m2, least_m2)
    return float(shift_m @ np.linalg.solve(gained_m2, shift_m)) <= CHI2_95


def _has_moved(stood: MapObject, item: MapObject) -> bool:
    """Whether an object stands elsewhere, by more than its estimate may change."""
    if item is stood or math.dist(stood.place_m, item.place_m) <= MOVED_M:
        return False
    away_m = item.position_m - stood.position_m
    return float(away_m @ np.linalg.solve(stood.covariance_m2 + item.covariance_m2, away_m)) > CHI2_997
