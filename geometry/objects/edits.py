"""Edits of a map by people: names, confirmations, corrections, deletions, merges, zones and the dock.

Edits never touch the measured map: they are laid over it when it is read, so the same drive makes the same measured
map with and without them.
"""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from edgemap.geometry.errors import MapError
from edgemap.geometry.map_object import MapObject, id_order
from edgemap.geometry.objects.annotations import (
    LONGEST_NAME,
    MAXIMUM_CORNERS,
    MAXIMUM_ZONES,
    NO_ANNOTATIONS,
    Annotations,
    Corners,
    Zone,
    corners_of,
)
from edgemap.geometry.objects.class_posterior import least_spacing_m
from edgemap.geometry.objects.corrections import Correction, added_object, fault_of
from edgemap.geometry.objects.floor_map import FloorMap
from edgemap.geometry.objects.merge import fused
from edgemap.geometry.observations.class_extents import HEIGHT_M, footprint_m
from edgemap.geometry.se2 import SE2
from edgemap.geometry.slam.landmarks import LandmarkRule
from edgemap.geometry.trajectory_correction import TrajectoryCorrection

EditKind = Literal[
    "rename",
    "confirm",
    "correct",
    "add",
    "delete",
    "merge",
    "restore",
    "zone",
    "drop_zone",
    "dock",
    "drop_dock",
    "pose",
]

MAXIMUM_ADDED = 1000
ADDED = "-added"  # between label and number of the id of an object that a person has added
USUAL_WIDTH_M = 0.5  # of an added object whose class has no usual size
MINIMUM_ZONE_M2 = 0.01


class EditError(MapError):
    """An edit that the map does not allow."""


@dataclass(frozen=True, slots=True)
class Edit:
    """One edit by a person.

    rename: `id` is called `name`; empty takes the name away. confirm: a person confirms `id` (`on`) or withdraws the
    confirmation. correct: `id` has this `label`, `place_m`, `size_m` and `yaw_rad`, each where given. add: a new object
    with these values, without detections. delete: `id` is not there. merge: `id` is the same object as `into`. restore:
    takes back delete, merge and correct of `id`. zone: a zone `id`, or a new one where it is empty, has `name` and
    `corners_m`. drop_zone: zone `id` goes. dock: the dock is at `pose`; drop_dock: there is none. pose: the robot is at
    `pose` now, with standard deviations `sigmas`. Poses: x, y, yaw; m, m, rad.
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


@dataclass(slots=True)
class _DrawnZone:
    """anchors_s: stamp of the pose nearest to each corner, with which it moves; None in a map that was loaded."""

    zone: Zone
    anchors_s: np.ndarray | None = None


@dataclass(slots=True)
class MapEdits:
    """All edits of a map so far. Ids are those that the map shows; edits follow an object through merges and changes of
    id.
    """

    names: dict[str, str] = field(default_factory=dict)
    confirmed: set[str] = field(default_factory=set)
    deleted: dict[str, frozenset[str]] = field(default_factory=dict)  # with the labels that it was detected as
    joined: dict[str, str] = field(default_factory=dict)
    corrections: dict[str, Correction] = field(default_factory=dict)
    added: dict[str, MapObject] = field(default_factory=dict)
    dock: SE2 | None = None
    _dock_anchor_s: float | None = None  # stamp of the pose nearest to the dock, where it was set in this run
    _zones: dict[str, _DrawnZone] = field(default_factory=dict)
    _issued: int = 0
    _version: int = 0
    _seen: tuple[int, list[MapObject]] | None = None
    _shown: list[MapObject] = field(default_factory=list)
    _hidden: tuple[MapObject, ...] = ()
    _annotations: Annotations = NO_ANNOTATIONS
    _made: dict[str, tuple[tuple, MapObject, list[MapObject]]] = field(default_factory=dict)

    @classmethod
    def of(cls, saved: Iterable[MapObject], annotations: Annotations, placed: bool = True) -> "MapEdits":
        """The edits that a saved map holds. placed: whether its zones and its dock have a position yet; without one
        they come with `enter`.
        """
        edits = cls()
        for item in saved:
            if item.name:
                edits.names[item.id] = item.name
            if item.confirmed:
                edits.confirmed.add(item.id)
            if item.corrected:
                edits.corrections[item.id] = Correction.of(item)
        edits.deleted = {item.id: _labels(item) for item in annotations.deleted}
        if placed:
            edits._zones = {zone.id: _DrawnZone(zone) for zone in annotations.zones}
            edits.dock = annotations.dock
        edits._issued = max((id_order(zone.id)[1] for zone in annotations.zones), default=0)
        return edits

    @property
    def zones(self) -> tuple[Zone, ...]:
        """The zones, in the order in which they were drawn."""
        return tuple(drawn.zone for drawn in self._zones.values())

    def take(self, edit: Edit, measured: FloorMap, anchors: Callable[[Corners], np.ndarray]) -> str:
        """Do an edit; the id of its object or zone. measured: the map. anchors: stamps (N,) of the poses nearest to
        points (N, 2). Raises EditError, and changes nothing."""
        identity = self._take(edit, measured, anchors)
        self._version += 1
        return identity

    def _take(self, edit: Edit, measured: FloorMap, anchors: Callable[[Corners], np.ndarray]) -> str:
        if edit.do == "zone":
            return self._put_zone(edit, anchors)
        if edit.do == "drop_zone":
            if self._zones.pop(edit.id, None) is None:
                raise EditError(f"no zone {edit.id!r}")
            return edit.id
        if edit.do in ("dock", "drop_dock"):
            return self._put_dock(edit, anchors)
        if edit.do == "restore":
            if not any(edit.id in some for some in (self.deleted, self.joined, self.corrections)):
                raise EditError(f"{edit.id!r} was neither deleted nor merged nor corrected")
            # The last thing first: an object that was corrected and then deleted comes back corrected.
            next(some for some in (self.deleted, self.joined, self.corrections) if edit.id in some).pop(edit.id)
            return edit.id
        if edit.do == "add":
            return self._add(edit, anchors)
        shown = {item.id: item for item in self.shown(measured)}
        for identity in (edit.id, edit.into) if edit.do == "merge" else (edit.id,):
            if identity not in shown:
                raise EditError(f"no object {identity!r} on the map")
        if edit.do == "rename":
            self._rename(edit.id, edit.name, measured)
        elif edit.do == "confirm":
            self.confirmed = {one for one in self.confirmed if self._root(one, measured) != edit.id}
            self.confirmed |= {edit.id} if edit.on else set()
        elif edit.do == "correct":
            self._correct(edit, measured, anchors)
        elif edit.do == "delete":
            self.deleted[edit.id] = _labels(shown[edit.id])
        elif edit.id == edit.into:
            raise EditError(f"{edit.id!r} cannot be merged with itself")
        else:
            self.joined[edit.id] = edit.into
        return edit.id

    def shown(self, measured: FloorMap) -> list[MapObject]:
        """The measured map's objects with the edits applied; the same list where there are none."""
        objects = measured.objects()
        if not (self.names or self.confirmed or self.deleted or self.joined or self.corrections or self.added):
            self._hidden = ()
            return objects
        if self._seen is None or self._seen[0] != self._version or self._seen[1] is not objects:
            self._seen = (self._version, objects)
            self._lay_over(objects, measured)
        return self._shown

    def annotations(self, measured: FloorMap) -> Annotations:
        """Zones and deleted objects as they stand; the very same as long as they do."""
        if self.deleted:
            self.shown(measured)
        now = Annotations(self.zones, self._hidden, self.dock)
        if now != self._annotations:
            self._annotations = now
        return self._annotations

    def kept(self, measured: FloorMap) -> frozenset[str]:
        """Ids of the measured map that a person has confirmed: they are not forgotten."""
        return frozenset(self._place(identity, measured) for identity in self.confirmed)

    def merges(self, measured: FloorMap) -> dict[str, str]:
        """Ids that a person has merged into others, to those."""
        return {one: self._root(one, measured) for one in self.joined} if self.joined else {}

    def moved(self, correction: TrajectoryCorrection) -> None:
        """A loop closure moves each place that was set in this run with the pose nearest to it."""
        self._move(correction.moved_points)
        if self.dock is not None and self._dock_anchor_s is not None:
            anchor_s, pose = np.array([self._dock_anchor_s]), self.dock.vector()[None]
            self.dock = SE2(*correction.moved_poses(anchor_s, pose)[0].tolist())

    def scale(self, factor: float) -> None:
        """All places times `factor`, about the map's origin. Sizes that a person has set stay."""
        self._move(lambda _, points_m: factor * points_m)
        self.dock = self.dock and self.dock.scaled(factor)

    def enter(self, annotations: Annotations, pose_saved_own: SE2) -> None:
        """This run's zones, corrections and dock move into a saved map's frame, and that map's zones come first.
        annotations: of the saved map. pose_saved_own: pose of this run's map in it.
        """
        self._move(lambda _, points_m: pose_saved_own.apply(points_m))
        self._zones = {zone.id: _DrawnZone(zone) for zone in annotations.zones} | self._zones
        if self.dock is None or self._dock_anchor_s is None:
            self.dock = annotations.dock
        else:
            self.dock = pose_saved_own @ self.dock

    def _move(self, move: Callable[[np.ndarray, np.ndarray], np.ndarray]) -> None:
        """Moves the zones and corrections that were set in this run. move: takes the stamps (N,) that places were
        anchored to, and the places (N, 2), to the places that they have now.
        """
        for drawn in self._zones.values():
            if drawn.anchors_s is not None:
                places = move(drawn.anchors_s, np.array(drawn.zone.corners_m))
                drawn.zone = replace(drawn.zone, corners_m=corners_of(places))
        for identity, said in self.corrections.items():
            if said.place_m is not None and said.anchor_s is not None:
                (place,) = corners_of(move(np.array([said.anchor_s]), np.array([said.place_m])))
                self.corrections[identity] = replace(said, place_m=place)
        self._version += 1

    def _rename(self, identity: str, name: str, measured: FloorMap) -> None:
        if len(name) > LONGEST_NAME or not (name.isprintable() and name == name.strip()):
            raise EditError(f"a name has at most {LONGEST_NAME} printable characters and no space at its ends")
        self.names = {one: name_of for one, name_of in self.names.items() if self._root(one, measured) != identity}
        if name:
            self.names[identity] = name

    def _correct(self, edit: Edit, measured: FloorMap, anchors: Callable[[Corners], np.ndarray]) -> None:
        said = _correction(edit, anchors)
        if said == Correction():
            raise EditError(f"nothing of {edit.id!r} is to be corrected: give a label, a position, a size or a yaw")
        roots = {one: self._root(one, measured) for one in self.corrections}
        for one in [one for one, root in roots.items() if root == edit.id]:
            said = self.corrections.pop(one).updated(said)
        self.corrections[edit.id] = said

    def _add(self, edit: Edit, anchors: Callable[[Corners], np.ndarray]) -> str:
        said = _correction(edit, anchors)
        if not said.label or said.place_m is None:
            raise EditError("a new object needs a label and a position")
        if said.size_m is None:
            width_m, depth_m = footprint_m(said.label, USUAL_WIDTH_M)
            said = replace(said, size_m=(width_m, depth_m, HEIGHT_M.get(said.label, (USUAL_WIDTH_M, 0.0))[0]))
        if len(self.added) >= MAXIMUM_ADDED:
            raise EditError(f"{MAXIMUM_ADDED} objects are added already")
        # Never an id that the measured map gives: it numbers its own classes only.
        taken = [id_order(one)[1] for one in {*self.added, *self.corrections, *self.names} if ADDED in one]
        identity = f"{said.label}{ADDED}-{max(taken, default=0) + 1}"
        self.added[identity] = added_object(identity, said, said.anchor_s or 0.0)
        self.corrections[identity] = said
        self.confirmed.add(identity)
        return identity

    def _put_dock(self, edit: Edit, anchors: Callable[[Corners], np.ndarray]) -> str:
        if edit.do == "drop_dock":
            self.dock = None
            return "dock"
        if edit.pose is None or not all(map(math.isfinite, edit.pose)):
            raise EditError("a dock needs a pose: x, y and yaw")
        self.dock, self._dock_anchor_s = SE2(*edit.pose), float(anchors((edit.pose[:2],))[0])
        return "dock"

    def _put_zone(self, edit: Edit, anchors: Callable[[Corners], np.ndarray]) -> str:
        if edit.id and edit.id not in self._zones:
            raise EditError(f"no zone {edit.id!r}")
        if not edit.id and len(self._zones) >= MAXIMUM_ZONES:
            raise EditError(f"{MAXIMUM_ZONES} zones are drawn already")
        if not 3 <= len(edit.corners_m) <= MAXIMUM_CORNERS or _area_m2(edit.corners_m) < MINIMUM_ZONE_M2:
            raise EditError(f"a zone has 3 to {MAXIMUM_CORNERS} corners around at least {MINIMUM_ZONE_M2} m2")
        if not edit.name or len(edit.name) > LONGEST_NAME or not edit.name.isprintable():
            raise EditError(f"a zone has a name of at most {LONGEST_NAME} printable characters")
        identity = edit.id
        if not identity:
            self._issued += 1
            identity = f"zone-{self._issued}"
        self._zones[identity] = _DrawnZone(Zone(identity, edit.name, edit.corners_m), anchors(edit.corners_m))
        return identity

    def _place(self, identity: str, measured: FloorMap) -> str:
        """The id under which the measured map shows what was once this object."""
        return measured.shown_as(measured.merged.get(identity, identity))

    def _joins(self, measured: FloorMap) -> dict[str, str]:
        """What people have merged, by the ids that the measured map shows."""
        return {self._place(one, measured): self._place(other, measured) for one, other in self.joined.items()}

    def _root(self, identity: str, measured: FloorMap, joins: Mapping[str, str] | None = None) -> str:
        """`_place` after all that people have merged. joins: `_joins`, for whoever asks often."""
        joins = self._joins(measured) if joins is None else joins
        identity, passed = self._place(identity, measured), set[str]()
        while identity in joins and identity not in passed:
            passed.add(identity)
            identity = joins[identity]
        return identity

    def _with_added(self, objects: list[MapObject], joins: dict[str, str]) -> tuple[list[MapObject], dict[str, str]]:
        """The measured objects and those that people have added; one of a label that was detected where another was
        added is that one."""
        if not self.added:
            return objects, joins
        known, joins = {item.id for item in objects}, dict(joins)
        added = [self.corrections[one].apply(item) for one, item in self.added.items() if one not in known]
        for ours in added:
            for item in objects:
                near_m = float(np.linalg.norm(item.position_m - ours.position_m))
                if item.id not in joins and item.label == ours.label and near_m < least_spacing_m(ours, item):
                    joins[item.id] = ours.id
        return [*objects, *added], joins

    def _lay_over(self, objects: list[MapObject], measured: FloorMap) -> None:
        joins = self._joins(measured)
        out = {self._root(identity, measured, joins): labels for identity, labels in self.deleted.items()}
        objects, joins = self._with_added(objects, joins)
        there, groups, hidden = {item.id for item in objects}, dict[str, list[MapObject]](), list[MapObject]()
        for item in objects:
            root = self._root(item.id, measured, joins) if joins else item.id
            root = root if root in there else item.id
            if item.label in out.get(root, ()):  # what stands there by now under another label is something else
                hidden.append(item)
            else:
                groups.setdefault(root, []).append(item)
        names = {self._root(identity, measured, joins): name for identity, name in self.names.items()}
        confirmed = {self._root(identity, measured, joins) for identity in self.confirmed}
        said = {self._root(identity, measured, joins): one for identity, one in self.corrections.items()}
        shown, made = [], {}
        for root, parts in groups.items():
            parts.sort(key=lambda item: (item.id != root, id_order(item.id)))
            name, is_confirmed = names.get(root, ""), root in confirmed
            key = (*map(id, parts), name, is_confirmed, said.get(root))
            kept_item = self._made.get(root)
            is_same = kept_item is not None and kept_item[0] == key
            item = kept_item[1] if kept_item and is_same else _edited(parts, name, is_confirmed, said.get(root))
            made[root] = (key, item, parts)  # the parts are kept alive, so that an id() stays theirs
            shown.append(item)
        self._made, self._shown = made, sorted(shown, key=lambda item: id_order(item.id))
        self._hidden = tuple(hidden)


def joined(parts: Sequence[MapObject]) -> MapObject:
    """Objects that are one, the first one's id kept; its label is the likeliest by all of them."""
    item = parts[0]
    for part in parts[1:]:
        item = fused(item, part, LandmarkRule())
    if len(parts) > 1 and item.labels:
        item = replace(item, label=max(item.labels, key=lambda label: (item.labels[label], label == item.label)))
    return item


def _edited(parts: list[MapObject], name: str, confirmed: bool, said: Correction | None) -> MapObject:
    """One object of those that are it, with what people have said of it."""
    item = joined(parts)
    if said is not None:
        item = said.apply(item)
    if (name, confirmed) == (item.name, item.confirmed):
        return item
    return replace(item, name=name, confirmed=confirmed, confidence=1.0 if confirmed else item.confidence)


def _correction(edit: Edit, anchors: Callable[[Corners], np.ndarray]) -> Correction:
    """What an edit says of an object. Raises EditError."""
    anchor_s = None if edit.place_m is None else float(anchors((edit.place_m,))[0])
    said = Correction(edit.label, edit.place_m, edit.size_m, edit.yaw_rad, anchor_s)
    if fault := fault_of(said):
        raise EditError(fault)
    if edit.label and (
        len(edit.label) > LONGEST_NAME or not edit.label.isprintable() or edit.label.strip() != edit.label
    ):
        raise EditError(f"a label has at most {LONGEST_NAME} printable characters and no space at its ends")
    return said


def _labels(item: MapObject) -> frozenset[str]:
    return frozenset({item.label, *item.labels})


def _area_m2(corners_m: Corners) -> float:
    x, y = np.array(corners_m).T
    return abs(float(x @ np.roll(y, 1) - y @ np.roll(x, 1))) / 2.0
