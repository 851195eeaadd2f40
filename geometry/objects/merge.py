"""Two maps of one place become one: what is one thing is fused, everything else is carried over."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from edgemap.geometry.objects.association import AssociationRule
from edgemap.geometry.objects.map_object import MapObject, id_order
from edgemap.geometry.objects.observation_pool import positive
from edgemap.geometry.observations.class_extents import extent_m
from edgemap.geometry.registration.alignment import Alignment, jacobian

Array = NDArray[np.float64]


def moved(item: MapObject, alignment: Alignment) -> MapObject:
    """An object of the second map in the first one's frame, with the alignment's own uncertainty on top."""
    pose = alignment.pose_a_b
    rotation, wrt_pose = pose.rotation(), jacobian(pose, item.position_m)
    covariance = rotation @ item.covariance_m2 @ rotation.T + wrt_pose @ alignment.covariance @ wrt_pose.T
    views = tuple((float(x), float(y)) for x, y in pose.apply(np.reshape(item.seen_from_m, (-1, 2))))
    return replace(item, position_m=pose.apply(item.position_m), covariance_m2=covariance, seen_from_m=views)


def merge_maps(
    first: Sequence[MapObject], second: Sequence[MapObject], alignment: Alignment, rule: AssociationRule | None = None
) -> tuple[list[MapObject], dict[str, str]]:
    """One map in the first one's frame, ordered by id, and the second map's ids to what they became.

    The first map's ids stay; an object that only the second map has keeps its own id where the first map has no such,
    else it gets the next free number of its label. Counts add up, times span both, confidence is that not both are
    wrong, and positions are weighted by their information.
    """
    rule = rule or AssociationRule()
    partner = {j: i for i, j in alignment.pairs}
    found = {item.id: item for item in first}
    highest: Counter[str] = Counter()
    for item in [*first, *second]:
        label, number = id_order(item.id)
        highest[label] = max(highest[label], number)
    became: dict[str, str] = {}
    for j, item in enumerate(second):
        here = moved(item, alignment)
        if j in partner:
            ours = first[partner[j]]
            found[ours.id] = fused(ours, here, rule)
            became[item.id] = ours.id
            continue
        identity = item.id
        if identity in found:
            highest[item.label] += 1
            identity = f"{item.label}-{highest[item.label]}"
        found[identity] = replace(here, id=identity)
        became[item.id] = identity
    return sorted(found.values(), key=lambda item: id_order(item.id)), became


def fused(ours: MapObject, theirs: MapObject, rule: AssociationRule) -> MapObject:
    """One object of two sightings of it by different maps, in one frame; id and label of the first.

    What a box does not tell of the footprint is the same error in both maps: it does not shrink.
    """
    systematic_m = max(rule.systematic_m, rule.systematic_extent_share * extent_m(ours.label, ours.width_m))
    floor_m2 = np.eye(2) * systematic_m**2
    a, b = (np.linalg.inv(positive(item.covariance_m2 - floor_m2, least=1e-4)) for item in (ours, theirs))
    spread = np.linalg.inv(a + b)
    smallest = min(np.trace(ours.covariance_m2), np.trace(theirs.covariance_m2))
    covariance = spread + floor_m2
    if np.trace(covariance) > smallest:  # either map was surer than the floor
        covariance = min(ours.covariance_m2, theirs.covariance_m2, key=np.trace)
    count = ours.count + theirs.count
    share = ours.count / count
    return MapObject(
        ours.id, ours.label, spread @ (a @ ours.position_m + b @ theirs.position_m), covariance,
        share * ours.width_m + (1 - share) * theirs.width_m, share * ours.height_m + (1 - share) * theirs.height_m,
        count, 1.0 - (1.0 - ours.confidence) * (1.0 - theirs.confidence),
        min(ours.first_seen_s, theirs.first_seen_s), max(ours.last_seen_s, theirs.last_seen_s),
        ours.seen_from_m + theirs.seen_from_m,
    )  # fmt: skip
