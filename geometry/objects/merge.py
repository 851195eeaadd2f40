"""Merges two maps of one place: matched objects are fused, all others are copied."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from edgemap.geometry.arrays import CHI2_997, Array, positive
from edgemap.geometry.map_object import MapObject, id_order
from edgemap.geometry.objects.class_posterior import APART
from edgemap.geometry.observations.class_extents import extent_m
from edgemap.geometry.registration.alignment import Alignment, Pairs, jacobian
from edgemap.geometry.slam.landmarks import LandmarkRule


def moved(item: MapObject, alignment: Alignment) -> MapObject:
    """An object of the second map in the first one's frame, with the alignment's own uncertainty on top."""
    pose = alignment.pose_a_b
    rotation, wrt_pose = pose.rotation(), jacobian(pose, item.position_m)
    covariance = rotation @ item.covariance_m2 @ rotation.T + wrt_pose @ alignment.covariance @ wrt_pose.T
    views = tuple((float(x), float(y)) for x, y in pose.apply(np.reshape(item.seen_from_m, (-1, 2))))
    return replace(item, position_m=pose.apply(item.position_m), covariance_m2=covariance, seen_from_m=views)


def merge_maps(
    first: Sequence[MapObject], second: Sequence[MapObject], alignment: Alignment, rule: LandmarkRule | None = None
) -> tuple[list[MapObject], dict[str, str]]:
    """One map in the first one's frame, ordered by id, and the new ids of the second map's objects.

    The first map's ids stay; an object that only the second map has keeps its id where the first map does not use it,
    and otherwise gets the next free number of its label. Counts add up, times span both, the confidence is the
    probability that not both are wrong, and positions are weighted by their information. Overlapping objects of one
    label are one object, even if their covariances disagree; the fused covariance then covers their distance.
    """
    rule = rule or LandmarkRule()
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
    paired, near = ({i for i, _ in pairs}, {j for _, j in pairs}), list[tuple[float, int, int]]()
    for label in {item.label for item in first} & {item.label for item in second}:
        ours, theirs = (
            [row for row, item in enumerate(items) if item.label == label and row not in gone]
            for items, gone in zip((first, second), paired, strict=True)
        )
        (a, extents_a), (b, extents_b) = (
            _standing([items[row] for row in rows]) for items, rows in ((first, ours), (second, theirs))
        )
        distances_m = np.linalg.norm(a[:, None] - b[None], axis=-1)
        spacing_m = APART * np.minimum(extents_a[:, None], extents_b[None])
        near += [(float(distances_m[i, j]), ours[i], theirs[j]) for i, j in np.argwhere(distances_m < spacing_m)]
    found: dict[int, int] = {}
    taken: set[int] = set()
    for _, i, j in sorted(near):
        if i not in found and j not in taken:
            found[i] = j
            taken.add(j)
    return tuple(found.items())


def _standing(objects: Sequence[MapObject]) -> tuple[Array, Array]:
    """Positions (N, 2) and extents (N,), metres."""
    positions_m = np.array([item.position_m for item in objects]).reshape(-1, 2)
    return positions_m, np.array([extent_m(item.label, item.width_m) for item in objects])


def fused(ours: MapObject, theirs: MapObject, rule: LandmarkRule) -> MapObject:
    """One object of two sightings of it by different maps, in one frame; id and label of the first.

    The part of a footprint that no box shows is the same error in both maps: it does not shrink. Where the two differ
    by more than their covariances allow (99.7 %), these are scaled until they agree (Birge ratio).
    """
    difference = theirs.position_m - ours.position_m
    chi2 = float(difference @ np.linalg.solve(ours.covariance_m2 + theirs.covariance_m2, difference))
    if chi2 > CHI2_997:
        ours, theirs = (replace(item, covariance_m2=item.covariance_m2 * chi2 / 2.0) for item in (ours, theirs))
    floor_m2 = np.eye(2) * rule.centre_m2(extent_m(ours.label, ours.width_m))
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
