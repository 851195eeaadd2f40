"""Two maps of one place become one: what is one object is fused, everything else is carried over."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from edgemap.geometry.objects.association import AssociationRule
from edgemap.geometry.objects.class_posterior import least_spacing_m
from edgemap.geometry.objects.map_object import MapObject, id_order
from edgemap.geometry.objects.observation_pool import positive
from edgemap.geometry.observations.class_extents import extent_m
from edgemap.geometry.registration.alignment import Alignment, Pairs, jacobian

CHI2_99 = 9.21


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
    wrong, and positions are weighted by their information. Objects of one label that would stand in one another are
    one, though their covariances disagree: the fused one is as unsure as they differ.
    """
    rule = rule or AssociationRule()
    here = [moved(item, alignment) for item in second]
    partner = {j: i for i, j in (*alignment.pairs, *_overlapping(first, here, alignment.pairs))}
    found = {item.id: item for item in first}
    highest: Counter[str] = Counter()
    for item in [*first, *second]:
        label, number = id_order(item.id)
        highest[label] = max(highest[label], number)
    became: dict[str, str] = {}
    for j, item in enumerate(second):
        if j in partner:
            ours = first[partner[j]]
            found[ours.id] = fused(ours, here[j], rule)
            became[item.id] = ours.id
            continue
        identity = item.id
        if identity in found:
            highest[item.label] += 1
            identity = f"{item.label}-{highest[item.label]}"
        found[identity] = replace(here[j], id=identity)
        became[item.id] = identity
    return sorted(found.values(), key=lambda item: id_order(item.id)), became


def _overlapping(first: Sequence[MapObject], second: Sequence[MapObject], pairs: Pairs) -> Pairs:
    """Unpaired objects of both maps, in one frame, that cannot stand side by side: nearest first, one to one."""
    ours = [i for i in range(len(first)) if i not in {i for i, _ in pairs}]
    theirs = [j for j in range(len(second)) if j not in {j for _, j in pairs}]
    near = sorted(
        (float(np.linalg.norm(first[i].position_m - second[j].position_m)), i, j)
        for i in ours
        for j in theirs
        if first[i].label == second[j].label
    )
    found: dict[int, int] = {}
    for distance_m, i, j in near:
        if distance_m < least_spacing_m(first[i], second[j]) and i not in found and j not in found.values():
            found[i] = j
    return tuple(found.items())


def fused(ours: MapObject, theirs: MapObject, rule: AssociationRule) -> MapObject:
    """One object of two sightings of it by different maps, in one frame; id and label of the first.

    The part of a footprint that no box shows is the same error in both maps: it does not shrink. Where the two differ
    by more than their covariances allow (99 %), these are scaled until they agree (Birge ratio).
    """
    difference = theirs.position_m - ours.position_m
    chi2 = float(difference @ np.linalg.solve(ours.covariance_m2 + theirs.covariance_m2, difference))
    if chi2 > CHI2_99:
        ours, theirs = (replace(item, covariance_m2=item.covariance_m2 * chi2 / 2.0) for item in (ours, theirs))
    systematic_m = max(rule.systematic_m, rule.systematic_extent_share * extent_m(ours.label, ours.width_m))
    floor_m2 = np.eye(2) * systematic_m**2
    a, b = (np.linalg.inv(positive(item.covariance_m2 - floor_m2, least=1e-4)) for item in (ours, theirs))
    own_m2 = np.linalg.inv(a + b)
    smallest = min(np.trace(ours.covariance_m2), np.trace(theirs.covariance_m2))
    covariance = own_m2 + floor_m2
    if np.trace(covariance) > smallest:  # either map was surer than the floor
        covariance = min(ours.covariance_m2, theirs.covariance_m2, key=np.trace)
    count = ours.count + theirs.count
    share = ours.count / count
    return MapObject(
        ours.id, ours.label, own_m2 @ (a @ ours.position_m + b @ theirs.position_m), covariance,
        share * ours.width_m + (1 - share) * theirs.width_m, share * ours.height_m + (1 - share) * theirs.height_m,
        count, 1.0 - (1.0 - ours.confidence) * (1.0 - theirs.confidence),
        min(ours.first_seen_s, theirs.first_seen_s), max(ours.last_seen_s, theirs.last_seen_s),
        ours.seen_from_m + theirs.seen_from_m,
        {label: share * ours.labels.get(label, 0.0) + (1 - share) * theirs.labels.get(label, 0.0)
         for label in {**ours.labels, **theirs.labels}},
        ours.name or theirs.name, ours.confirmed or theirs.confirmed,
    )  # fmt: skip
