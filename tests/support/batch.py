"""The default clustering's batch version: all sightings at once. The measure of the online one."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from edgemap.geometry.objects.association import AssociationRule, Estimate
from edgemap.geometry.objects.class_posterior import Candidate, Overlaps
from edgemap.geometry.objects.map_object import MapObject
from edgemap.geometry.objects.observation_pool import ObservationPool, keys_of
from edgemap.geometry.objects.pool_index import PoolIndex
from edgemap.geometry.observations.sighting import PlacedSighting


def batch_objects(frames: Iterable[Sequence[PlacedSighting]], rule: AssociationRule | None = None) -> list[MapObject]:
    """Pool the sightings of all frames, in whatever order, then agglomerate the pools of each label.

    Ids count the objects of each label by first sighting.
    """
    rule = rule or AssociationRule()
    indices: dict[str, PoolIndex] = {}
    for number, frame in enumerate(frames, start=1):
        for label in {placed.label for placed in frame}:
            of_label = [placed for placed in frame if placed.label == label]
            index, pools = indices.setdefault(label, PoolIndex(rule)), []
            for key, placed in zip(keys_of(of_label), of_label, strict=True):
                known = index.row_of.get(key)
                pool = ObservationPool(key, placed.sighting.extent_m) if known is None else index.pool(known)
                pool.add(placed, number)
                index.add(pool) if known is None else index.set(pool.row)
                pools.append(pool)
            for pool in pools:
                pool.beside.update(dict.fromkeys(other for other in pools if other is not pool))
    overlaps, found = Overlaps(rule.overlap), {}
    for label, index in indices.items():
        objects = sorted(_estimates(index, rule), key=lambda item: item.sums.first_seen_s)
        for number, item in enumerate(objects, start=1):
            found[f"{label}-{number}"] = label, item
            width_m, evidence = item.sums.width_m / item.sums.count, item.sums.weight * item.sums.confidence
            overlaps.set(Candidate(f"{label}-{number}", label, item.position_m, width_m, evidence))
    overlaps.settle()
    shown = []
    for identity, members in overlaps.members.items():
        label, item = found[identity]
        if item.shows([found[other.id][1].sums for other in members[1:] if other.label != label]):
            shown.append(item.as_object(identity, label))
    return shown


def _estimates(index: PoolIndex, rule: AssociationRule) -> list[Estimate]:
    """Objects of one label's pools: those that are not linked, directly or through others, never meet."""
    left, found = set(index.row_of.values()), []
    for row in sorted(left):
        index.link(row)
    while left:
        part = index.connected({min(left)})
        left -= part
        groups = index.agglomerated(sorted(part, key=lambda row: index.pool(row).key))
        found += [Estimate([index.pool(row) for row in group], rule) for group in groups]
    return found
