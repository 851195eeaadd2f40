"""The maps of several robots become one map of the place they share; a map that fits nowhere stays apart."""

from __future__ import annotations

from collections.abc import Collection, Mapping, MutableMapping
from dataclasses import dataclass, field, replace

from edgemap.geometry.objects.edits import NO_ANNOTATIONS, Annotations, Zone
from edgemap.geometry.objects.map_object import MapObject
from edgemap.geometry.objects.merge import merge_maps, moved
from edgemap.geometry.registration.alignment import Alignment, AlignmentError, aligning
from edgemap.geometry.se2 import SE2

UNITS_OF_WORK = 300  # of one alignment: some 60 million distances between objects, about a second


@dataclass(frozen=True, slots=True, eq=False)
class RobotMap:
    """What one robot has mapped, in a frame of its own. key: the same for equal maps only."""

    key: str
    objects: tuple[MapObject, ...]
    zones: tuple[Zone, ...] = ()


@dataclass(frozen=True, slots=True)
class MergedRobot:
    """What became of one robot's map.

    pose_place_map: its frame in the place's; None where it stays apart, for `reason`.
    pairs: its objects that matched, of `shared` that could by their labels; 0 for the map that came first.
    """

    pose_place_map: SE2 | None
    pairs: int = 0
    shared: int = 0
    reason: str = ""


@dataclass(frozen=True, slots=True, eq=False)
class PlaceMap:
    """objects, annotations: of all maps that fit together, in the place's frame. members: every robot's part in it."""

    objects: tuple[MapObject, ...] = ()
    annotations: Annotations = NO_ANNOTATIONS
    members: Mapping[str, MergedRobot] = field(default_factory=dict)


Alignments = MutableMapping[tuple[str, ...], Alignment | str]


def merge_place(
    maps: Mapping[str, RobotMap], reference: RobotMap | None = None, known: Alignments | None = None
) -> PlaceMap:
    """One map from each robot's latest map, by name: it depends on these alone, so nothing ever counts twice.

    Maps are joined as `align` and `merge_maps` do, richest first; those that fit onto each other are a group, and the
    group of most robots is the place. Its frame is that of `reference`, a map of the place made before, which is
    merged too; without one that of its first robot by name. known: alignments found in the call before, and
    those of this one when it returns.
    """
    before, found = dict(known or {}), dict[tuple[str, ...], Alignment | str]()
    fleet = _Registration({**maps, "": reference} if reference else dict(maps), before, found)
    groups = list[_Group]()
    for name in sorted(fleet.maps, key=lambda name: (name != "", -len(fleet.maps[name].objects), name)):
        if not any(name in group.members for group in groups):
            groups.append(fleet.grown(_Group.of(name, fleet.maps[name]), _outside(fleet.maps, groups)))
    if not groups:
        return PlaceMap()
    place = max(groups, key=lambda group: ("" in group.members, len(group.members)))  # of equals the first, the richest
    place = fleet.grown(place, fleet.maps)
    reasons = {name: fleet.fit(place, name) for name in fleet.maps if name not in place.members}
    if known is not None:
        known.clear()
        known.update(found)
    to_place = place.members[min(place.members)].pose_place_map
    assert to_place is not None
    to_reference = Alignment.exact(to_place.inverse())
    members = {name: MergedRobot(None, reason=str(reason)) for name, reason in reasons.items()}
    for name, member in place.members.items():
        if name and member.pose_place_map is not None:
            members[name] = replace(member, pose_place_map=to_reference.pose_a_b @ member.pose_place_map)
    objects = tuple(moved(item, to_reference) for item in place.objects)
    return PlaceMap(
        objects, NO_ANNOTATIONS.with_zones(place.annotations.zones, to_reference), dict(sorted(members.items()))
    )


def _outside(maps: Mapping[str, RobotMap], groups: list[_Group]) -> list[str]:
    return [name for name in maps if not any(name in group.members for group in groups)]


@dataclass(frozen=True, slots=True, eq=False)
class _Group:
    """Maps that fit onto each other, merged in the first one's frame. keys: of the maps, in the order of merging."""

    keys: tuple[str, ...]
    objects: list[MapObject]
    annotations: Annotations
    members: dict[str, MergedRobot]

    @classmethod
    def of(cls, name: str, single: RobotMap) -> _Group:
        annotations = NO_ANNOTATIONS.with_zones(single.zones, Alignment.exact(SE2()))
        return cls((single.key,), list(single.objects), annotations, {name: MergedRobot(SE2())})

    def joined(self, name: str, single: RobotMap, alignment: Alignment) -> _Group:
        objects, _ = merge_maps(self.objects, single.objects, alignment)
        member = MergedRobot(alignment.pose_a_b, len(alignment.pairs), alignment.shared)
        zones = self.annotations.with_zones(single.zones, alignment)
        return _Group((*self.keys, single.key), objects, zones, self.members | {name: member})


@dataclass(frozen=True, slots=True, eq=False)
class _Registration:
    maps: dict[str, RobotMap]
    before: Alignments
    found: Alignments

    def grown(self, group: _Group, names: Collection[str]) -> _Group:
        """A group with all that fit onto it; who does not at first may fit onto what the others add."""
        waiting = sorted(names, key=lambda name: (-len(self.maps[name].objects), name))
        size = 0
        while size < len(group.members):
            size = len(group.members)
            for name in waiting:
                if name not in group.members and isinstance(fit := self.fit(group, name), Alignment):
                    group = group.joined(name, self.maps[name], fit)
        return group

    def fit(self, group: _Group, name: str) -> Alignment | str:
        """How a map lies in a group, or why that is not certain."""
        key = (*group.keys, self.maps[name].key)
        if key not in self.found:
            self.found[key] = self.before[key] if key in self.before else self._aligned(group, name)
        return self.found[key]

    def _aligned(self, group: _Group, name: str) -> Alignment | str:
        work = aligning(group.objects, self.maps[name].objects)
        try:
            for _ in range(UNITS_OF_WORK):
                next(work)
        except StopIteration as end:
            return end.value
        except AlignmentError as error:
            return str(error)
        return f"too many motions to try between {len(group.objects)} and {len(self.maps[name].objects)} objects"
