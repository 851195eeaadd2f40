"""A person's edits of a map: one list of events, folded over the measured objects when the map is read.

The measured map never changes, so a drive makes the same measured map with and without edits, and taking an edit back
drops its event.
"""

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, Literal, NamedTuple

import numpy as np

from edgemap.geometry.arrays import Array
from edgemap.geometry.errors import MapError
from edgemap.geometry.grid.rooms import Room, polygon_m2
from edgemap.geometry.map_object import Ids, MapObject, as_places, id_order
from edgemap.geometry.objects.annotations import (
    ADDED,
    LONGEST_NAME,
    MAXIMUM_CORNERS,
    MAXIMUM_ZONES,
    NO_ANNOTATIONS,
    Annotations,
    Corners,
    Zone,
)
from edgemap.geometry.objects.candidates import least_spacing_m
from edgemap.geometry.objects.floor_map import FloorMap
from edgemap.geometry.objects.merge import CORRECTABLE, fused
from edgemap.geometry.observations.class_extents import HEIGHT_M, footprint_m
from edgemap.geometry.se2 import SE2
from edgemap.geometry.slam.object_landmarks import LandmarkRule
from edgemap.geometry.trajectory_correction import TrajectoryCorrection, composed

EditKind = Literal["name", "confirm", "correct", "add", "merge", "delete", "zone", "room", "dock", "pose", "undo"]
UNDOABLE = ("correct", "merge", "delete", "zone", "room", "dock")

PLACED_SIGMA_M = 0.05  # for a position that a person sets on a map: a finger's width at the usual zoom
SMALLEST_M, LARGEST_M = 0.02, 20.0  # limits of a size that a person sets; a zone is larger than the smallest square
USUAL_WIDTH_M = 0.5  # of an added object whose class has no usual size
STATED = {"label": "label", "position": "place_m", "size": "size_m", "yaw": "yaw_rad"}  # by an `Edit`, as `CORRECTABLE`

Anchors = Callable[[Corners], np.ndarray]


class EditError(MapError):
    """An edit that the map does not allow."""


@dataclass(frozen=True, slots=True)
class Edit:
    """One edit by a person.

    name: `id` is called `name`; empty takes the name away. confirm: a person confirms `id` (`on`) or withdraws the
    confirmation. correct: `id` has this `label`, `place_m`, `size_m` and `yaw_rad`, each where set. add: a new object
    with these values, without detections. merge: `id` is the same object as `into`. delete: `id` is not there. zone: a
    zone `id`, or a new one where it is empty, has `name` and `corners_m`. room: the room `id`, whose outline is
    `corners_m`, is called `name`; empty takes the name away. dock: the dock is at `pose`. pose: the robot is at `pose`
    now, or in the dock (`id` dock), with standard deviations `sigmas`. undo: drops the last of correct, merge and
    delete of the object `id`, the zone or room `id`, or the dock (`dock`). Sizes: width, depth, height. Poses: x, y,
    yaw; m, m, rad.
    """

    do: EditKind
    id: str = ""
    name: str = ""
    on: bool = True
    into: str = ""
    corners_m: Corners = ()
    label: str = ""
    place_m: tuple[float, float] | None = None
    size_m: tuple[float, float, float] | None = None
    yaw_rad: float | None = None
    pose: tuple[float, float, float] | None = None
    sigmas: tuple[float, float, float] | None = None


class _Event(NamedTuple):
    """anchors_s: stamp (1,) of the pose nearest to the place of the edit, with which it moves as one piece; None where
    it was loaded with a map. labels: that a deleted object was detected as.
    """

    edit: Edit
    anchors_s: np.ndarray | None = None
    labels: frozenset[str] = frozenset()


_Events = dict[tuple[str, str], _Event]  # by kind and id: of one kind and id the last one counts


class _Fold:
    """The map while events are folded over it. objects: by id. became: merged ids with those they became part of."""

    def __init__(self, measured: FloorMap, events: _Events) -> None:
        self.measured, self.events = measured, events
        self.objects = {item.id: item for item in measured.objects()}
        self.became: dict[str, str] = {}
        self.deleted: list[MapObject] = []
        for event in events.values():
            self._apply(event)
        for item in [item for item in self.objects.values() if item.confirmed and item.confidence < 1.0]:
            self.objects[item.id] = replace(item, confidence=1.0)
        self.shown = sorted(self.objects.values(), key=lambda item: id_order(item.id))

    def root(self, identity: str) -> str:
        """The id under which the map shows what was once this object."""
        identity = self.measured.shown_as(identity)
        while identity in self.became:
            identity = self.became[identity]
        return identity

    def join(self, identity: str, into: str) -> None:
        """Makes two objects one, if both are there."""
        identity, into = self.root(identity), self.root(into)
        if identity != into and {identity, into} <= self.objects.keys():
            self.objects[into] = joined(self.objects[into], self.objects.pop(identity))
            self.became[identity] = into

    def _apply(self, event: _Event) -> None:
        edit, item = event.edit, self.objects.get(self.root(event.edit.id))
        if edit.do == "add":
            self._add(event)
        elif item is None:  # it is no longer there, or the edit is of no object
            return
        elif edit.do == "name":
            self.objects[item.id] = replace(item, name=edit.name)
        elif edit.do == "confirm":
            self.objects[item.id] = replace(item, confirmed=edit.on)
        elif edit.do == "correct":
            self.objects[item.id] = _corrected(item, edit)
        elif edit.do == "merge":
            self.join(item.id, edit.into)
        elif item.label in event.labels:  # deleted; under another label it is something else by now
            self.deleted.append(self.objects.pop(item.id))

    def _add(self, event: _Event) -> None:
        """Detections of its class in its place become part of it; the place is that of the latest correction."""
        edit = event.edit
        stamp_s = 0.0 if event.anchors_s is None else float(event.anchors_s[0])
        none = np.zeros(2), np.eye(2)
        item = MapObject(edit.id, edit.label, *none, 0.0, 0.0, 1, 1.0, stamp_s, stamp_s, confirmed=True)
        item = self.objects[edit.id] = _corrected(item, edit)
        correction = self.events.get(("correct", edit.id))
        final = item if correction is None else _corrected(item, correction.edit)
        for other in [one for one in self.objects.values() if ("add", one.id) not in self.events]:
            near_m = float(np.linalg.norm(other.position_m - final.position_m))
            if other.label == final.label and near_m < least_spacing_m(final, other):
                self.join(other.id, edit.id)


@dataclass(slots=True)
class MapEvents:
    """All edits of a map so far. Ids are those that the map shows; an event follows its object through merges of the
    measured map.
    """

    _events: _Events = field(default_factory=dict)
    _zone_ids: Ids = field(default_factory=Ids)
    _folded: tuple[list[MapObject], _Fold] | None = None

    @classmethod
    def after(cls, zones: Iterable[Zone]) -> "MapEvents":
        """No edits yet; new zones are numbered after these."""
        return cls(_zone_ids=Ids(zone.id for zone in zones))

    @classmethod
    def of(cls, saved: Iterable[MapObject], annotations: Annotations) -> "MapEvents":
        """The edits that a saved map holds."""
        items = (*saved, *annotations.deleted)
        edits = [replace(_correction_of(item), do="add") for item in items if ADDED in item.id]
        edits += [Edit("name", item.id, name=item.name) for item in items if item.name]
        edits += [Edit("confirm", item.id) for item in items if item.confirmed]
        edits += [_correction_of(item) for item in items if item.corrected and ADDED not in item.id]
        edits += [Edit("zone", zone.id, zone.name, corners_m=zone.corners_m) for zone in annotations.zones]
        edits += [Edit("room", room.id, room.name, corners_m=room.corners_m) for room in annotations.rooms if room.name]
        if (dock := annotations.dock) is not None:
            edits.append(Edit("dock", "dock", pose=(dock.x_m, dock.y_m, dock.yaw_rad)))
        events = [_Event(edit) for edit in edits]
        events += [_Event(Edit("delete", item.id), labels=_labels(item)) for item in annotations.deleted]
        made = cls.after(annotations.zones)
        made._events = {(event.edit.do, event.edit.id): event for event in events}
        return made

    def take(self, edit: Edit, measured: FloorMap, anchors: Anchors) -> str:
        """Adds an edit. Returns the id of its object or zone. anchors: stamps (N,) of the poses nearest to points (N,
        2). Raises EditError, and changes nothing.
        """
        if edit.do == "undo":
            self._undo(edit.id, measured)
            return edit.id
        shown = {item.id: item for item in self.shown(measured)}
        edit = self._checked(edit, shown)
        key, labels = (edit.do, edit.id), _labels(shown[edit.id]) if edit.do == "delete" else frozenset[str]()
        place_m = np.mean(edit.corners_m, axis=0) if edit.corners_m else edit.pose[:2] if edit.pose else edit.place_m
        if place_m is None and edit.yaw_rad is not None:  # a yaw alone moves with its object
            place_m = shown[edit.id].position_m
        event = _Event(edit, None if place_m is None else anchors(as_places(place_m)), labels)
        before = self._events.get(key)
        if before is not None and edit.do == "correct":
            moves_alone = before.edit.place_m is None and edit.yaw_rad is not None
            anchors_s = event.anchors_s if edit.place_m is not None or moves_alone else before.anchors_s
            event = _Event(_updated(before.edit, edit), anchors_s)
        if edit.do != "zone":  # zones keep their order
            self._events.pop(key, None)
        self._events[key] = event
        self._folded = None
        return edit.id

    def shown(self, measured: FloorMap) -> list[MapObject]:
        """The measured map's objects with the edits applied; the same list where there are none."""
        return self._fold(measured).shown if self._events else measured.objects()

    def annotations(self, measured: FloorMap) -> Annotations:
        """Current zones, deleted objects, dock and named rooms."""
        if not self._events:
            return NO_ANNOTATIONS
        edits = [event.edit for event in self._events.values()]
        zones = (Zone(edit.id, edit.name, edit.corners_m) for edit in edits if edit.do == "zone")
        rooms = (Room(edit.id, edit.corners_m, name=edit.name) for edit in edits if edit.do == "room")
        dock = next((SE2(*edit.pose) for edit in edits if edit.do == "dock" and edit.pose), None)
        return Annotations(tuple(zones), tuple(self._fold(measured).deleted), dock, tuple(rooms))

    def kept(self, measured: FloorMap) -> frozenset[str]:
        """Ids of the measured map that a person has confirmed or named: they are not forgotten."""
        edits = (event.edit for event in self._events.values())
        kept = (one.id for one in edits if (one.do == "confirm" and one.on) or (one.do == "name" and one.name))
        return frozenset(measured.shown_as(identity) for identity in kept)

    def merges(self, measured: FloorMap) -> dict[str, str]:
        """Ids that became part of others by merges and additions, to those."""
        if not any(kind in ("merge", "add") for kind, _ in self._events):
            return {}
        fold = self._fold(measured)
        ids = {*fold.became, *(identity for kind, identity in self._events if kind == "merge")}
        return {one: fold.root(one) for one in sorted(ids) if fold.root(one) != one}

    def moved(self, correction: TrajectoryCorrection) -> None:
        """Applies a loop closure: each place that was set in this run moves with the pose nearest to it."""
        self._move(correction.moved_poses)

    def enter(self, saved: Iterable[MapObject], annotations: Annotations, pose_saved_own: SE2) -> None:
        """This run's edits move into a saved map's frame, and that map's edits come first. pose_saved_own: pose of this
        run's map in it."""
        self._move(lambda _, poses: composed(pose_saved_own.vector()[None], poses))
        self._events = MapEvents.of(saved, annotations)._events | self._events

    def _move(self, move: Callable[[np.ndarray, Array], Array]) -> None:
        """Moves the places that were set in this run. move: takes stamps (N,) and poses (N, 3) to poses now."""
        for key, event in self._events.items():
            if event.anchors_s is not None:
                self._events[key] = event._replace(edit=_moved(event.edit, partial(move, event.anchors_s)))
        self._folded = None

    def _fold(self, measured: FloorMap) -> _Fold:
        objects = measured.objects()
        if self._folded is None or self._folded[0] is not objects:
            self._folded = objects, _Fold(measured, self._events)
        return self._folded[1]

    def _undo(self, identity: str, measured: FloorMap) -> None:
        keys = [key for key in self._events if key[0] in UNDOABLE and identity in (key[1], measured.shown_as(key[1]))]
        if not keys:
            raise EditError(f"{identity!r} was neither corrected nor merged nor deleted, and is no zone")
        del self._events[keys[-1]]
        self._folded = None

    def _checked(self, edit: Edit, shown: dict[str, MapObject]) -> Edit:
        """Validates an edit and gives a new zone or object its id. Raises EditError where the map does not allow it."""
        _check_name(edit.name, "a name")
        if edit.do == "zone":
            return self._checked_zone(edit)
        if edit.do == "dock":
            if edit.pose is None:
                raise EditError("a dock needs a pose: x, y and yaw")
            return replace(edit, id="dock")
        if edit.do == "room":
            if not edit.id or not 3 <= len(edit.corners_m) <= MAXIMUM_CORNERS:
                raise EditError("a room has an id and an outline")
            return edit
        if edit.do in ("correct", "add"):
            _check_values(edit)
        if edit.do == "add":
            return self._checked_addition(edit)
        for identity in (edit.id, edit.into) if edit.do == "merge" else (edit.id,):
            if identity not in shown:
                raise EditError(f"no object {identity!r} on the map")
        if edit.do == "merge" and edit.id == edit.into:
            raise EditError(f"{edit.id!r} cannot be merged with itself")
        return edit

    def _checked_addition(self, edit: Edit) -> Edit:
        if not edit.label or edit.place_m is None:
            raise EditError("a new object needs a label and a position")
        # Never an id that the measured map gives: it numbers its own classes only.
        numbers = (id_order(identity)[1] for _, identity in self._events if ADDED in identity)
        identity = f"{edit.label}{ADDED}-{max(numbers, default=0) + 1}"
        width_m, depth_m = footprint_m(edit.label, USUAL_WIDTH_M)
        usual_m = width_m, depth_m, HEIGHT_M.get(edit.label, (USUAL_WIDTH_M, 0.0))[0]
        return replace(edit, id=identity, size_m=edit.size_m or usual_m)

    def _checked_zone(self, edit: Edit) -> Edit:
        zones = [identity for kind, identity in self._events if kind == "zone"]
        if edit.id and edit.id not in zones:
            raise EditError(f"no zone {edit.id!r}")
        if not edit.id and len(zones) >= MAXIMUM_ZONES:
            raise EditError(f"{MAXIMUM_ZONES} zones are drawn already")
        if not 3 <= len(edit.corners_m) <= MAXIMUM_CORNERS or polygon_m2(edit.corners_m) < SMALLEST_M**2:
            raise EditError(f"a zone has 3 to {MAXIMUM_CORNERS} corners around at least {SMALLEST_M**2:g} m2")
        if not edit.name:
            raise EditError("a zone has a name")
        return replace(edit, id=edit.id or self._zone_ids.new("zone"))


def joined(ours: MapObject, theirs: MapObject) -> MapObject:
    """Joins two objects under the first one's id; the label is the most probable by both, or the stated one."""
    item = fused(ours, theirs, LandmarkRule())
    return replace(
        item, label=max(item.labels, key=lambda label: (item.labels[label], label == item.label), default=item.label)
    )


def _corrected(item: MapObject, edit: Edit) -> MapObject:
    """The object with the values that an edit states."""
    values: dict[str, Any] = {"label": edit.label, "labels": {edit.label: 1.0}} if edit.label else {}
    if edit.place_m is not None:
        values |= {"position_m": np.array(edit.place_m), "covariance_m2": np.eye(2) * PLACED_SIGMA_M**2}
    if edit.size_m is not None:
        values |= zip(CORRECTABLE["size"], edit.size_m, strict=True)
    if edit.yaw_rad is not None:
        values["yaw_rad"] = edit.yaw_rad
    words = (word for word, (name, *_) in CORRECTABLE.items() if name in values or word in item.corrected)
    return replace(item, corrected=tuple(words), **values)


def _correction_of(item: MapObject) -> Edit:
    """The correction that is stored in a saved object."""
    size_m = item.width_m, item.depth_m or item.width_m, item.height_m
    values: dict[str, Any] = {"label": item.label, "position": item.place_m, "size": size_m, "yaw": item.yaw_rad}
    return Edit("correct", item.id, **{STATED[word]: values[word] for word in item.corrected})


def _updated(older: Edit, newer: Edit) -> Edit:
    """A correction with the values replaced that a newer one states."""
    stated = {name: getattr(newer, name) for name in STATED.values()}
    return replace(older, **{name: value for name, value in stated.items() if value not in ("", None)})


def _check_values(edit: Edit) -> None:
    """Raises EditError where a correction states nothing, or what no object has."""
    if edit.label == "" and edit.place_m is edit.size_m is edit.yaw_rad is None:
        raise EditError(f"nothing of {edit.id!r} is to be corrected: give a label, a position, a size or a yaw")
    if edit.size_m is not None and not all(SMALLEST_M <= side <= LARGEST_M for side in edit.size_m):
        sides = " x ".join(f"{side:g}" for side in edit.size_m)
        raise EditError(f"a size is width, depth and height of {SMALLEST_M} to {LARGEST_M:g} m each, not {sides} m")
    _check_name(edit.label, "a label")


def _moved(edit: Edit, move: Callable[[Array], Array]) -> Edit:
    """The edit at another place, a zone as one piece. move: takes poses (1, 3) to others."""
    place_m, corners_m = edit.place_m or (math.nan, math.nan), np.array(edit.corners_m)
    before = (*corners_m.mean(axis=0), 0.0) if edit.corners_m else edit.pose or (*place_m, edit.yaw_rad or 0.0)
    x_m, y_m, yaw_rad = move(np.array([before]))[0].tolist()
    if edit.corners_m:
        return replace(edit, corners_m=as_places(SE2(x_m, y_m, yaw_rad).apply(corners_m - before[:2])))
    if edit.pose:
        return replace(edit, pose=(x_m, y_m, yaw_rad))
    return replace(edit, place_m=edit.place_m and (x_m, y_m), yaw_rad=None if edit.yaw_rad is None else yaw_rad)


def _labels(item: MapObject) -> frozenset[str]:
    return frozenset({item.label, *item.labels})


def _check_name(text: str, what: str) -> None:
    """Raises EditError for a name or a label that no map may hold."""
    if len(text) > LONGEST_NAME or not text.isprintable() or text != text.strip():
        raise EditError(f"{what} has at most {LONGEST_NAME} printable characters and no space at its ends")
