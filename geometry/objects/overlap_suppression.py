"""Two things never stand in the same place: of objects that overlap too much, what is seen less is not real."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.spatial import KDTree

from edgemap.geometry.objects.map_object import MapObject
from edgemap.geometry.observations.class_extents import extent_m, footprint_m

# Least distance of two middles: of one label, as a share of the smaller one's extent; of two, of half the sum of both
# shorter sides, below which they would stand in one another (chairs go under tables, and places are not exact).
SAME_LABEL, OTHER_LABEL = 0.8, 0.6
# Two chairs pushed together are seen about as often as each other; a double far less often than the thing itself.
FAR_LESS = 0.5


def least_spacing_m(a: MapObject, b: MapObject) -> float:
    """How near two objects of one label can stand to each other, middle to middle."""
    return SAME_LABEL * min(extent_m(item.label, item.width_m) for item in (a, b))


def without_overlaps(objects: Sequence[MapObject]) -> list[MapObject]:
    """Drop every object whose middle lies too near that of one with more evidence (count times confidence): of the same
    label over twice as much, of another one any more.

    A detector now and then calls one thing by two names, or boxes a part of it beside the whole. Order is kept.
    """
    if len(objects) < 2:
        return list(objects)
    extents_m = np.array([extent_m(item.label, item.width_m) for item in objects])
    sides_m = np.array([min(footprint_m(item.label, item.width_m)) for item in objects])
    places = np.array([item.position_m for item in objects])
    pairs = KDTree(places).query_pairs(SAME_LABEL * float(extents_m.max()), output_type="ndarray")
    if len(pairs) == 0:
        return list(objects)
    seen = np.array([item.count * item.confidence for item in objects])
    pairs = np.where((seen[pairs[:, :1]] >= seen[pairs[:, 1:]]), pairs, pairs[:, ::-1])  # the better seen one first
    same = np.array([objects[a].label == objects[b].label for a, b in pairs])
    spacing_m = np.where(
        same,
        SAME_LABEL * np.minimum(extents_m[pairs[:, 0]], extents_m[pairs[:, 1]]),
        OTHER_LABEL * (sides_m[pairs[:, 0]] + sides_m[pairs[:, 1]]) / 2.0,
    )
    less = seen[pairs[:, 1]] < np.where(same, FAR_LESS, 1.0) * seen[pairs[:, 0]]
    close = pairs[(np.linalg.norm(places[pairs[:, 0]] - places[pairs[:, 1]], axis=1) < spacing_m) & less]
    dropped: set[int] = set()
    for better, worse in sorted(close.tolist(), key=lambda pair: (-seen[pair[0]], pair)):
        if better not in dropped:
            dropped.add(worse)
    return [item for row, item in enumerate(objects) if row not in dropped]
