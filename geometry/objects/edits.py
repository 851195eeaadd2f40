"""What people say of a map: names, confirmations, deletions, joins and zones, beside what was measured.

Edits never touch the measured map: they are laid over it when it is read, so the same drive makes the same measured
map with and without them.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from edgemap.geometry.errors import MapError
from edgemap.geometry.objects.association import AssociationRule
from edgemap.geometry.objects.map_object import MapObject, ObjectMap, id_order
from edgemap.geometry.objects.merge import fused
from edgemap.geometry.registration.alignment import Alignment
from edgemap.geometry.slam.keyframes import TrajectoryCorrection

Corners = tuple[tuple[float, float], ...]
EditKind = Literal["rename", "confirm", "delete", "merge", "restore", "zone", "drop_zone"]

MAXIMUM_CORNERS, MAXIMUM_ZONES, LONGEST_NAME = 100, 200, 80
MINIMUM_ZONE_M2 = 0.01


class EditError(MapError):
    """An edit that the map does not allow."""


@dataclass(frozen=True, slots=True)
class Zone:
    """A named part of the floor. corners_m: its polygon in the map frame, at least three."""

    id: str
    name: str
    corners_m: Corners


@dataclass(frozen=True, slots=True)
class Annotations:
    """What a map holds beside its objects. deleted: objects that a person has taken out, so that they stay out."""

    zones: tuple[Zone, ...] = ()
    deleted: tuple[MapObject, ...] = ()

    def measured(self, saved: Sequence[MapObject]) -> list[MapObject]:
        """All that a saved map has measured: its objects, the deleted ones too, without what people have said."""
        return [replace(item, name="", confirmed=False) for item in (*saved, *self.deleted)]

    def with_zones(self, zones: Sequence[Zone], alignment: Alignment) -> "Annotations":
        """Another map's zones added, in this one's frame and with the next free ids."""
        last = max((id_order(zone.id)[1] for zone in self.zones), default=0)
        added = (
            Zone(f"zone-{number}", zone.name, _corners(alignment.pose_a_b.apply(np.array(zone.corners_m))))
            for number, zone in enumerate(zones, last + 1)
        )
        return replace(self, zones=(*self.zones, *added)[:MAXIMUM_ZONES])


NO_ANNOTATIONS = Annotations()


@dataclass(frozen=True, slots=True)
class Edit:
    """One thing that a person did.

    rename: `id` is called `name`; empty takes the name away. confirm: a person has seen `id` there (`on`) or takes that
    back. delete: `id` is not there. merge: `id` is the same object as `into`. restore: takes back delete and merge of
    `id`. zone: a zone `id`, or a new one where it is empty, has `name` and `corners_m`. drop_zone: zone `id` goes.
    """

    do: EditKind
    id: str = ""
    name: str = ""
    on: bool = True
    into: str = ""
    corners_m: Corners = ()


@dataclass(slots=True)
class _DrawnZone:
    """anchors_s: stamp of the pose nearest to each corner, with which it moves; None in a map that was loaded."""

    zone: Zone
    anchors_s: np.ndarray | None = None


@dataclass(slots=True)
class MapEdits:
    """All edits of a map so far. Ids are those that the map shows; what merges or is renamed by it is followed."""

    names: dict[str, str] = field(default_factory=dict)
    confirmed: set[str] = field(default_factory=set)
    deleted: dict[str, frozenset[str]] = field(default_factory=dict)  # with the labels that it was detected as
    joined: dict[str, str] = field(default_factory=dict)
    _zones: dict[str, _DrawnZone] = field(default_factory=dict)
    _issued: int = 0
    _version: int = 0
    _seen: tuple[int, list[MapObject]] | None = None
    _shown: list[MapObject] = field(default_factory=list)
    _hidden: tuple[MapObject, ...] = ()
    _annotations: Annotations = NO_ANNOTATIONS
    _made: dict[str, tuple[tuple, MapObject, list[MapObject]]] = field(default_factory=dict)

    @classmethod
    def of(cls, saved: Iterable[MapObject], annotations: Annotations) -> "MapEdits":
        """The edits that a saved map holds."""
        edits = cls()
        for item in saved:
            if item.name:
                edits.names[item.id] = item.name
            if item.confirmed:
                edits.confirmed.add(item.id)
        edits.deleted = {item.id: _labels(item) for item in annotations.deleted}
        edits._zones = {zone.id: _DrawnZone(zone) for zone in annotations.zones}
        edits._issued = max((id_order(zone.id)[1] for zone in annotations.zones), default=0)
        return edits

    @property
    def zones(self) -> tuple[Zone, ...]:
        """The zones, in the order in which they were drawn."""
        return tuple(drawn.zone for drawn in self._zones.values())

    def take(self, edit: Edit, measured: ObjectMap, anchors: Callable[[Corners], np.ndarray]) -> str:
        """Do an edit; the id of its object or zone. measured: the map. anchors: stamps (N,) of the poses nearest to
        points (N, 2). Raises EditError, and changes nothing."""
        identity = self._take(edit, measured, anchors)
        self._version += 1
        return identity

    def _take(self, edit: Edit, measured: ObjectMap, anchors: Callable[[Corners], np.ndarray]) -> str:
        if edit.do == "zone":
            return self._put_zone(edit, anchors)
        if edit.do == "drop_zone":
            if self._zones.pop(edit.id, None) is None:
                raise EditError(f"no zone {edit.id!r}")
            return edit.id
        if edit.do == "restore":
            if edit.id not in self.deleted and edit.id not in self.joined:
                raise EditError(f"{edit.id!r} was neither deleted nor merged")
            self.deleted.pop(edit.id, None)
            self.joined.pop(edit.id, None)
            return edit.id
        shown = {item.id: item for item in self.shown(measured)}
        for identity in (edit.id, edit.into) if edit.do == "merge" else (edit.id,):
            if identity not in shown:
                raise EditError(f"no object {identity!r} on the map")
        if edit.do == "rename":
            self._rename(edit.id, edit.name, measured)
        elif edit.do == "confirm":
            self.confirmed = {one for one in self.confirmed if self._root(one, measured) != edit.id}
            self.confirmed |= {edit.id} if edit.on else set()
        elif edit.do == "delete":
            self.deleted[edit.id] = _labels(shown[edit.id])
        elif edit.id == edit.into:
            raise EditError(f"{edit.id!r} cannot be merged with itself")
        else:
            self.joined[edit.id] = edit.into
        return edit.id

    def shown(self, measured: ObjectMap) -> list[MapObject]:
        """The measured map's objects as people have edited it; the very same list where nobody has."""
        objects = measured.objects()
        if not (self.names or self.confirmed or self.deleted or self.joined):
            self._hidden = ()
            return objects
        if self._seen is None or self._seen[0] != self._version or self._seen[1] is not objects:
            self._seen = (self._version, objects)
            self._lay_over(objects, measured)
        return self._shown

    def annotations(self, measured: ObjectMap) -> Annotations:
        """Zones and deleted objects as they stand; the very same as long as they do."""
        if self.deleted:
            self.shown(measured)
        if (self.zones, self._hidden) != (self._annotations.zones, self._annotations.deleted):
            self._annotations = Annotations(self.zones, self._hidden)
        return self._annotations

    def kept(self, measured: ObjectMap) -> frozenset[str]:
        """Ids of the measured map that a person has confirmed: they are not forgotten."""
        return frozenset(self._place(identity, measured) for identity in self.confirmed)

    def merges(self, measured: ObjectMap) -> dict[str, str]:
        """Ids that a person has merged into others, to those."""
        return {one: self._root(one, measured) for one in self.joined} if self.joined else {}

    def moved(self, correction: TrajectoryCorrection) -> None:
        """A loop closure moves each corner of a zone drawn in this run with the pose nearest to it."""
        for drawn in self._zones.values():
            if drawn.anchors_s is not None:
                places = correction.moved_points(drawn.anchors_s, drawn.zone.corners_m)
                drawn.zone = replace(drawn.zone, corners_m=_corners(places))

    def enter(self, zones: Sequence[Zone], alignment: Alignment) -> None:
        """This run's zones move into a saved map's frame, and that map's zones come first."""
        own = self._zones
        self._zones = {zone.id: _DrawnZone(zone) for zone in zones}
        for identity, drawn in own.items():
            places = alignment.pose_a_b.apply(np.array(drawn.zone.corners_m))
            self._zones[identity] = _DrawnZone(replace(drawn.zone, corners_m=_corners(places)), drawn.anchors_s)
        self._version += 1

    def take_zones(self) -> tuple[Zone, ...]:
        """The zones, which leave: until the robot has found itself in their map they have no place."""
        zones, self._zones = self.zones, {}
        return zones

    def _rename(self, identity: str, name: str, measured: ObjectMap) -> None:
        if len(name) > LONGEST_NAME or not (name.isprintable() and name == name.strip()):
            raise EditError(f"a name has at most {LONGEST_NAME} printable characters and no space at its ends")
        self.names = {one: name_of for one, name_of in self.names.items() if self._root(one, measured) != identity}
        if name:
            self.names[identity] = name

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

    def _place(self, identity: str, measured: ObjectMap) -> str:
        """The id under which the measured map shows what was once this object."""
        return measured.shown_as(measured.merged.get(identity, identity))

    def _joins(self, measured: ObjectMap) -> dict[str, str]:
        """What people have merged, by the ids that the measured map shows."""
        return {self._place(one, measured): self._place(other, measured) for one, other in self.joined.items()}

    def _root(self, identity: str, measured: ObjectMap, joins: Mapping[str, str] | None = None) -> str:
        """`_place` after all that people have merged. joins: `_joins`, for whoever asks often."""
        joins = self._joins(measured) if joins is None else joins
        identity, passed = self._place(identity, measured), set[str]()
        while identity in joins and identity not in passed:
            passed.add(identity)
            identity = joins[identity]
        return identity

    def _lay_over(self, objects: list[MapObject], measured: ObjectMap) -> None:
        joins = self._joins(measured)
        out = {self._root(identity, measured, joins): labels for identity, labels in self.deleted.items()}
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
        shown, made = [], {}
        for root, parts in groups.items():
            parts.sort(key=lambda item: (item.id != root, id_order(item.id)))
            name, is_confirmed = names.get(root, ""), root in confirmed
            key = (*map(id, parts), name, is_confirmed)
            kept_item = self._made.get(root)
            item = kept_item[1] if kept_item is not None and kept_item[0] == key else _edited(parts, name, is_confirmed)
            made[root] = (key, item, parts)  # the parts are kept alive, so that an id() stays theirs
            shown.append(item)
        self._made, self._shown = made, sorted(shown, key=lambda item: id_order(item.id))
        self._hidden = tuple(hidden)


def _edited(parts: list[MapObject], name: str, confirmed: bool) -> MapObject:
    """One object of those that are it, the first one's id kept."""
    item = parts[0]
    for part in parts[1:]:
        item = fused(item, part, AssociationRule())
    if (name, confirmed) == (item.name, item.confirmed):
        return item
    return replace(item, name=name, confirmed=confirmed, confidence=1.0 if confirmed else item.confidence)


def _labels(item: MapObject) -> frozenset[str]:
    return frozenset({item.label, *item.labels})


def _corners(places: np.ndarray) -> Corners:
    return tuple((float(x), float(y)) for x, y in places)


def _area_m2(corners_m: Corners) -> float:
    x, y = np.array(corners_m).T
    return abs(float(x @ np.roll(y, 1) - y @ np.roll(x, 1))) / 2.0
