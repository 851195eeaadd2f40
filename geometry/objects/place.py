"""The maps of several robots become one map of the place they share; a map that fits nowhere stays apart."""

from collections import Counter
from collections.abc import Callable, Collection, Mapping, MutableMapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace

import numpy as np

from edgemap.geometry.arrays import CHI2_997
from edgemap.geometry.errors import MapError
from edgemap.geometry.map_object import MapObject
from edgemap.geometry.objects.edits import NO_ANNOTATIONS, Annotations, Zone
from edgemap.geometry.objects.merge import fused, merge_maps, moved
from edgemap.geometry.registration.alignment import Alignment, AlignmentError, aligned_near, aligning
from edgemap.geometry.se2 import SE2
from edgemap.geometry.slam.landmarks import LandmarkRule

UNITS_OF_WORK = 300  # of one alignment: some 60 million distances between objects, about a second
TOTAL_UNITS = 600  # of one merge: two new robots of large maps; more wait for the next one
FREQUENT_UNITS = 150  # lately: who costs more joins after all others, whose alignments then stay known
WAITING = "waits for its turn: aligning it takes more work than one merge has left"
NEARLY = 0.8  # of the objects that matched before
STEEPEST = 4.0  # times the information of the median robot: more no single robot weighs


@dataclass(frozen=True, slots=True, eq=False)
class RobotMap:
    """One robot's map, in its own frame. key: equal only for equal maps."""

    key: str
    objects: tuple[MapObject, ...]
    zones: tuple[Zone, ...] = ()


@dataclass(frozen=True, slots=True)
class MergedRobot:
    """Result of merging one robot's map. pose_place_map: its frame in the place's; None where not merged, for `reason`.
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


class MergeStopped(MapError):
    """A merge that was asked to stop."""


@dataclass(slots=True)
class MergeBudget:
    """Computation budget of merges, per robot, in units of alignment; one instance serves many merges.

    arrived: sequence number of each robot's latest map. stopped: polled at every unit. waiting: robots whose alignment
    with the place is postponed. unfinished: an alignment was postponed, also one between two robots outside the place.
    lately: units that each robot has used, halved at every merge; an alignment of two robots outside the place is on
    both accounts, so that none who tries all the others comes first again. members: each robot's alignment in the
    previous merge, tried first for a map that has changed a little.
    """

    arrived: dict[str, int] = field(default_factory=dict)
    stopped: Callable[[], bool] = lambda: False
    each: int = UNITS_OF_WORK
    total: int = TOTAL_UNITS
    waiting: set[str] = field(default_factory=set)
    unfinished: bool = False
    lately: Counter[str] = field(default_factory=Counter)
    members: dict[str, MergedRobot] = field(default_factory=dict)
    _units: int = 0
    _spent: Counter[str] = field(default_factory=Counter)
    _owed: Counter[str] = field(default_factory=Counter)  # `lately` as this merge began

    def begin(self) -> None:
        """Start the next merge."""
        self.lately = Counter({name: units // 2 for name, units in self.lately.items() if units > 1})
        self._owed = Counter(self.lately)
        self._units = 0
        self._spent.clear()
        self.waiting.clear()
        self.unfinished = False

    def payers(self, name: str, members: Collection[str]) -> set[str]:
        """The robots whose budgets pay for an alignment: the robot itself until its first merge, then the one with the
        newest map; and who leads a group that is not the place.
        """
        leader = next(iter(members))
        if name not in self.members:
            return {name, leader} if leader and not self._in_place(leader) else {name}
        return {max({name, *members}, key=lambda one: (self.arrived.get(one, 0), one))}

    def left(self, payers: Collection[str]) -> int:
        """Units that these robots may still cost."""
        return min(*(self.each - self._spent[payer] for payer in payers), self.total - self._units)

    def spend(self, payers: Collection[str]) -> None:
        """One unit. Raises MergeStopped."""
        self._units += 1
        self._spent.update(payers)
        self.lately.update(payers)
        if self.stopped():
            raise MergeStopped("stopped")

    def turn(self, name: str) -> tuple[bool, bool, int]:
        """Sort key: robots of a place of two or more first, then those that use little, then strangers by their use."""
        known = self._in_place(name)
        return not known, self.last(name), 0 if known else self._owed[name]

    def _in_place(self, name: str) -> bool:
        """Whether a robot is in a place of two or more; alone, it has no more right to a turn than the others."""
        return len(self.members) > 1 and name in self.members

    def last(self, name: str) -> bool:
        """Whether a robot joins after all others."""
        return self.lately[name] > FREQUENT_UNITS


def merge_place(
    maps: Mapping[str, RobotMap],
    reference: RobotMap | None = None,
    known: Alignments | None = None,
    budget: MergeBudget | None = None,
) -> PlaceMap:
    """One map from each robot's latest map, by name. It depends on these maps alone, so no observation counts twice.

    Maps are joined as `align` and `merge_maps` do, richest first; those that fit onto each other are a group, and the
    group of most robots is the place. Its frame is that of `reference`, a map of the place made before, which is
    merged too; without one that of its first robot by name. known: alignments of the previous call; updated in place.
    budget: limit of the work; without one every alignment has its `UNITS_OF_WORK`. Postponed alignments are tried in
    the next call: robots of the place first, then those that have used least lately, so that strangers whose maps fit
    nowhere delay nobody. Raises MergeStopped.

    No robot outweighs the others: where two or more observe an object, none weighs more than `STEEPEST` times the
    median one, and where three or more do, those that contradict the median are left out.
    """
    before, found = dict(known or {}), dict[tuple[str, ...], Alignment | str]()
    budget = budget or MergeBudget(each=1 << 40, total=1 << 40)
    budget.begin()
    fleet = _Registration({**maps, "": reference} if reference else dict(maps), before, found, budget)
    groups = list[_Group]()
    for name in fleet.ordered(fleet.maps):
        if not any(name in group.members for group in groups):
            groups.append(fleet.grown(_Group.of(name, fleet.maps[name]), _outside(fleet.maps, groups)))
    if not groups:
        return PlaceMap()
    place = max(groups, key=lambda group: ("" in group.members, len(group.members)))  # of equals the first, the richest
    place = fleet.grown(place, fleet.maps)
    reasons = {name: fleet.fit(place, name) for name in fleet.maps if name not in place.members}
    budget.waiting.update(name for name, reason in reasons.items() if reason is WAITING)
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
    budget.members = {name: member for name, member in members.items() if member.pose_place_map is not None}
    objects = tuple(moved(balanced(place.parts[item.id]), to_reference) for item in place.objects)
    return PlaceMap(
        objects, NO_ANNOTATIONS.with_zones(place.annotations.zones, to_reference), dict(sorted(members.items()))
    )


def _outside(maps: Mapping[str, RobotMap], groups: "list[_Group]") -> list[str]:
    return [name for name in maps if not any(name in group.members for group in groups)]


@dataclass(frozen=True, slots=True, eq=False)
class _Group:
    """Maps that fit onto each other, merged in the first one's frame. keys: of the maps, in the order of merging.
    parts: what each robot has of an object, by id, in that frame."""

    keys: tuple[str, ...]
    objects: list[MapObject]
    annotations: Annotations
    members: dict[str, MergedRobot]
    parts: dict[str, tuple[MapObject, ...]]

    @classmethod
    def of(cls, name: str, single: RobotMap) -> "_Group":
        annotations = NO_ANNOTATIONS.with_zones(single.zones, Alignment.exact(SE2()))
        parts = {item.id: (item,) for item in single.objects}
        return cls((single.key,), list(single.objects), annotations, {name: MergedRobot(SE2())}, parts)

    def joined(self, name: str, single: RobotMap, alignment: Alignment) -> "_Group":
        objects, became = merge_maps(self.objects, single.objects, alignment)
        parts = dict(self.parts)
        for item in single.objects:
            identity = became[item.id]
            parts[identity] = (*parts.get(identity, ()), replace(moved(item, alignment), id=identity))
        member = MergedRobot(alignment.pose_a_b, len(alignment.pairs), alignment.shared)
        zones = self.annotations.with_zones(single.zones, alignment)
        return _Group((*self.keys, single.key), objects, zones, self.members | {name: member}, parts)


def balanced(parts: Sequence[MapObject]) -> MapObject:
    """Fuses several robots' estimates of one object, in one frame; keeps the first id. See `merge_place`."""
    if len(parts) == 1:
        return parts[0]
    median_m2, count = (
        sorted(values)[len(parts) // 2]
        for values in ([float(np.trace(item.covariance_m2)) for item in parts], [item.count for item in parts])
    )
    raised = [
        replace(
            item,
            count=min(item.count, int(STEEPEST * count)),
            covariance_m2=item.covariance_m2
            * max(1.0, median_m2 / STEEPEST / max(float(np.trace(item.covariance_m2)), 1e-12)),
        )
        for item in parts
    ]
    if len(parts) > 2:
        middle = np.median([item.position_m for item in raised], axis=0)
        spread = np.eye(2) * median_m2 / 2.0
        kept = [item for item in raised if _chi2(item.position_m - middle, item.covariance_m2 + spread) <= CHI2_997]
        raised = kept or raised
    result = raised[0]
    for item in raised[1:]:
        result = fused(result, item, LandmarkRule())
    return replace(result, id=parts[0].id, count=sum(item.count for item in parts))


def _chi2(difference: np.ndarray, covariance_m2: np.ndarray) -> float:
    return float(difference @ np.linalg.solve(covariance_m2, difference))


@dataclass(frozen=True, slots=True, eq=False)
class _Registration:
    maps: dict[str, RobotMap]
    before: Alignments
    found: Alignments
    budget: MergeBudget

    def ordered(self, names: Collection[str]) -> list[str]:
        """The reference first, then as the budget has it, then the richest first."""

        return sorted(
            names, key=lambda name: (name != "", *self.budget.turn(name), -len(self.maps[name].objects), name)
        )

    def grown(self, group: _Group, names: Collection[str]) -> _Group:
        """A group with all that fit onto it; who does not at first may fit onto what the others add."""
        waiting = self.ordered(names)
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
            fit = self.before[key] if key in self.before else self._aligned(group, name)
            if fit is WAITING:
                self.budget.unfinished = True
                return fit
            self.found[key] = fit
        return self.found[key]

    def _near(self, group: _Group, name: str) -> Alignment | None:
        """How a map lies in a group where nearly as many objects match as in the merge before, at the same place."""
        base, last = (self.budget.members.get(one) for one in (next(iter(group.members)), name))
        if base is None or last is None or base.pose_place_map is None or last.pose_place_map is None:
            return None
        guess = base.pose_place_map.inverse() @ last.pose_place_map
        with suppress(AlignmentError):
            found = aligned_near([guess], group.objects, self.maps[name].objects)
            if len(found.pairs) >= NEARLY * max(last.pairs, base.pairs):
                return found
        return None

    def _aligned(self, group: _Group, name: str) -> Alignment | str:
        payers, mine = self.budget.payers(name, group.members), self.maps[name].objects
        if (near := self._near(group, name)) is not None:
            self.budget.spend(payers)
            return near
        work, allowed = aligning(group.objects, mine), min(UNITS_OF_WORK, self.budget.left(payers))
        try:
            for _ in range(allowed):
                self.budget.spend(payers)
                next(work)
        except StopIteration as end:
            return end.value
        except AlignmentError as error:
            return str(error)
        if allowed < UNITS_OF_WORK:
            return WAITING
        return f"too many motions to try between {len(group.objects)} and {len(mine)} objects"
