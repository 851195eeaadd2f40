"""The default clustering's batch version: all sightings at once. The measure of the online one."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
from scipy.sparse.csgraph import connected_components

from edgemap.geometry.objects.association import AssociationRule, Estimate, Positions, agglomerated
from edgemap.geometry.objects.map_object import MapObject
from edgemap.geometry.objects.observation_pool import Key, ObservationPool, keys_of
from edgemap.geometry.objects.overlap_suppression import without_overlaps
from edgemap.geometry.observations.sighting import PlacedSighting


def batch_objects(frames: Iterable[Sequence[PlacedSighting]], rule: AssociationRule | None = None) -> list[MapObject]:
    """Pool the sightings of all frames, in whatever order, then agglomerate the pools of each label.

    Ids count the objects of each label by first sighting.
    """
    rule = rule or AssociationRule()
    pools: dict[str, dict[Key, ObservationPool]] = {}
    for number, frame in enumerate(frames, start=1):
        for label in {placed.label for placed in frame}:
            of_label = [placed for placed in frame if placed.label == label]
            known, keys = pools.setdefault(label, {}), keys_of(of_label)
            for key, placed in zip(keys, of_label, strict=True):
                pool = known.setdefault(key, ObservationPool(key, placed.sighting.extent_m))
                pool.add(placed, number)
                pool.beside.update(other for other in keys if other != key)
    found: list[MapObject] = []
    for label, known in pools.items():
        shown = [item for item in _estimates([known[key] for key in sorted(known)], rule) if item.shows]
        shown.sort(key=lambda item: item.sums.first_seen_s)
        found += [item.as_object(f"{label}-{number}", label) for number, item in enumerate(shown, start=1)]
    return without_overlaps(found)


def _estimates(pools: list[ObservationPool], rule: AssociationRule) -> list[Estimate]:
    """Objects of one label's pools: those that do not hang together, directly or through others, never meet."""
    places = Positions(rule)
    row_of = {pool.key: places.append(pool) for pool in pools}
    links = places.distances(slice(None)) < np.inf
    for row, pool in enumerate(pools):
        links[row, [row_of[key] for key in pool.beside]] = False
    _, parts = connected_components(links, directed=False)
    found: list[Estimate] = []
    for part in range(parts.max() + 1):
        rows = np.flatnonzero(parts == part).tolist()
        own = [pools[row] for row in rows]
        found += [Estimate([own[row] for row in group], rule) for group in agglomerated(places.chosen(rows), own)]
    return found
