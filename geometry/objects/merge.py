"""Merges maps of one place: fuses matched objects, copies all others and keeps edits."""

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from edgemap.geometry.arrays import CHI2_997, positive
from edgemap.geometry.grid.canvas import merged_grid
from edgemap.geometry.grid.occupancy_grid import OccupancyGrid
from edgemap.geometry.map_object import Ids, MapObject, id_order
from edgemap.geometry.objects.annotations import NO_ANNOTATIONS, Annotations
from edgemap.geometry.objects.candidates import APART
from edgemap.geometry.observations.class_extents import extent_m
from edgemap.geometry.registration.alignment import Alignment, AlignmentError, Pairs, align
from edgemap.geometry.registration.hypotheses import Places
from edgemap.geometry.se2 import SE2, by_pose
from edgemap.geometry.slam.object_landmarks import LandmarkRule

AnnotatedMap = tuple[Sequence[MapObject], Annotations]
CORRECTABLE = {
    "label": ("label", "labels"),
    "position": ("position_m", "covariance_m2"),
    "size": ("width_m", "depth_m", "height_m"),
    "yaw": ("yaw_rad",),
}  # fields of an object that a person sets by each word of `corrected`


def moved(item: MapObject, alignment: Alignment) -> MapObject:
    """An object of the second map in the first one's frame, with the alignment's covariance added."""
    pose, here = alignment.pose_a_b, item.transformed(alignment.pose_a_b)
    (wrt_pose,) = by_pose((pose.rotation() @ item.position_m)[None])
    return replace(here, covariance_m2=here.covariance_m2 + wrt_pose @ alignment.covariance @ wrt_pose.T)


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
    partner = {j: i for i, j in _paired(first, here, alignment.pairs)}
    merged, ids, became = {item.id: item for item in first}, Ids(item.id for item in (*first, *second)), {}
    for j, item in enumerate(here):
        if j in partner:
            ours = first[partner[j]]
            merged[ours.id], became[item.id] = fused(ours, item, rule), ours.id
        else:
            became[item.id] = ids.new(item.label) if item.id in merged else item.id
            merged[became[item.id]] = replace(item, id=became[item.id])
    return sorted(merged.values(), key=lambda item: id_order(item.id)), became


@dataclass(frozen=True, slots=True, eq=False)
class MergedMaps:
    """Maps that fit together as one, in the first one's frame. alignments: of each map that is in it, in the order of
    merging; pairs and shared count objects. refused: why each other map is not in it. grid: of those that have one.
    """

    objects: list[MapObject] = field(default_factory=list)
    annotations: Annotations = NO_ANNOTATIONS
    alignments: dict[str, Alignment] = field(default_factory=dict)
    refused: dict[str, str] = field(default_factory=dict)
    grid: OccupancyGrid | None = None


def merge_all(
    maps: Mapping[str, AnnotatedMap],
    base: str | None = None,
    grids: Mapping[str, OccupancyGrid | None] | None = None,
) -> MergedMaps:
    """One map of all that fit together by their objects and grids.

    base: the map whose frame counts and onto which the others are laid. Without one the largest group of maps that fit
    together is merged, in the frame of its first map; a map of another place is then left out.
    """
    grids = grids or {}

    def grown(group: MergedMaps, names: Collection[str]) -> MergedMaps:
        """Adds every map that fits, largest first. One that does not is tried again after others have added objects."""
        waiting = sorted((name for name in names if name not in group.alignments), key=lambda name: -len(maps[name][0]))
        refused: dict[str, str] = {}
        for name in waiting:
            try:
                alignment = align(group.objects, maps[name][0], (group.grid, grids.get(name)))
            except AlignmentError as error:
                refused[name] = str(error)
                continue
            merged = merge_annotated((group.objects, group.annotations), maps[name], alignment)
            grid = merged_grid(group.grid, grids.get(name), alignment.pose_a_b)
            group = MergedMaps(*merged, group.alignments | {name: alignment}, {}, grid)
        if refused and len(refused) < len(waiting):
            return grown(group, list(refused))
        return replace(group, refused=refused)

    groups, rest = list[MergedMaps](), list(maps) if base is None else [base]
    while rest:
        objects, annotations = maps[rest[0]]
        exact = {rest[0]: Alignment(SE2())}
        groups.append(grown(MergedMaps(list(objects), annotations, exact, {}, grids.get(rest[0])), rest))
        rest = [name for name in rest if name not in groups[-1].alignments]
    if not groups:
        return MergedMaps()
    return grown(max(groups, key=lambda group: (len(group.alignments), len(group.objects))), maps)


def merge_annotated(
    first: AnnotatedMap, second: AnnotatedMap, alignment: Alignment
) -> tuple[list[MapObject], Annotations]:
    """Two maps with their edits, in the first one's frame. An object that a person has deleted from one map is not
    taken from the other, unless a person has named, confirmed or corrected it there.
    """
    (ours, annotations), (theirs, more) = first, second
    merged, became = merge_maps(ours, theirs, alignment)
    first_ids, matched = {item.id for item in ours}, set(became.values())
    removed, more = [moved(item, alignment) for item in more.deleted], more.transformed(alignment.pose_a_b)
    gone: set[str] = set()
    for objects, deleted in (
        ([item for item in merged if item.id in first_ids and item.id not in matched], removed),
        ([item for item in merged if item.id not in first_ids], annotations.deleted),
    ):
        gone |= {objects[i].id for i, _ in _paired(objects, deleted)}
    merged = [item for item in merged if item.id not in gone or item.name or item.confirmed or item.corrected]
    kept, taken = list[MapObject](), {item.id for item in merged}
    ids = Ids(item.id for item in (*merged, *annotations.deleted, *removed))
    for item in (*annotations.deleted, *removed):
        kept.append(replace(item, id=ids.new(item.label)) if item.id in taken else item)
        taken.add(item.id)
    dock, identity = annotations.dock or more.dock, annotations.identity and annotations.identity.merged(more.identity)
    return merged, replace(annotations.with_areas(more), deleted=tuple(kept), dock=dock, identity=identity)


def _paired(first: Sequence[MapObject], second: Sequence[MapObject], pairs: Pairs = ()) -> Pairs:
    """These pairs of objects of two maps, in one frame, and with them all others that cannot stand side by side:
    nearest first, one to one."""
    ours, theirs = Places.of(first), Places.of(second)
    a_m, b_m = (np.array([extent_m(item.label, item.width_m) for item in items]) for items in (first, second))
    distances_m = np.linalg.norm(ours.positions_m[:, None] - theirs.positions_m, axis=-1)
    alike = ours.labels[:, None] == theirs.labels
    near = np.argwhere(alike & (distances_m < APART * np.minimum(a_m[:, None], b_m)))
    partner, taken = dict(pairs), {j for _, j in pairs}
    for i, j in sorted(near.tolist(), key=lambda pair: (distances_m[*pair], pair)):
        if i not in partner and j not in taken:
            partner[i] = j
            taken.add(j)
    return tuple(partner.items())


def fused(ours: MapObject, theirs: MapObject, rule: LandmarkRule) -> MapObject:
    """Fuses one object of two maps, in one frame; id and label of the first.

    The part of a footprint that no box shows is the same error in both maps: it does not shrink. Where the two differ
    by more than their covariances allow (99.7 %), these are scaled until they agree (Birge ratio). An edit replaces the
    estimate.
    """
    parts, difference = (ours, theirs), theirs.position_m - ours.position_m
    chi2 = float(difference @ np.linalg.solve(ours.covariance_m2 + theirs.covariance_m2, difference))
    if chi2 > CHI2_997:
        ours, theirs = (replace(item, covariance_m2=item.covariance_m2 * chi2 / 2.0) for item in (ours, theirs))
    floor_m2 = np.eye(2) * rule.centre_m2(extent_m(ours.label, ours.width_m))
    a, b = (np.linalg.inv(positive(item.covariance_m2 - floor_m2, least=1e-4)) for item in (ours, theirs))
    fused_m2 = np.linalg.inv(a + b)
    # One map may have less variance than the floor.
    covariance_m2 = min(fused_m2 + floor_m2, ours.covariance_m2, theirs.covariance_m2, key=np.trace)
    count = ours.count + theirs.count
    share = ours.count / count
    labels = {
        label: share * ours.labels.get(label, 0.0) + (1 - share) * theirs.labels.get(label, 0.0)
        for label in {**ours.labels, **theirs.labels}
    }
    estimate = replace(
        ours,
        position_m=fused_m2 @ (a @ ours.position_m + b @ theirs.position_m),
        covariance_m2=covariance_m2,
        width_m=share * ours.width_m + (1 - share) * theirs.width_m,
        height_m=share * ours.height_m + (1 - share) * theirs.height_m,
        count=count,
        confidence=1.0 - (1.0 - ours.confidence) * (1.0 - theirs.confidence),
        first_seen_s=min(ours.first_seen_s, theirs.first_seen_s),
        last_seen_s=max(ours.last_seen_s, theirs.last_seen_s),
        first_seen=_known(min, ours.first_seen, theirs.first_seen),
        last_seen=_known(max, ours.last_seen, theirs.last_seen),
        since=_known(max, ours.since, theirs.since),
        seen_from_m=ours.seen_from_m + theirs.seen_from_m,
        labels=labels,
        name=ours.name or theirs.name,
        confirmed=ours.confirmed or theirs.confirmed,
        measured=min(filter(None, (ours.measured, theirs.measured)), key=lambda one: one.yaw_sigma_rad, default=None),
    )
    return with_stated(estimate, parts)


def _known(choose: Callable[..., float], ours: float | None, theirs: float | None) -> float | None:
    """The earlier or later of two wall times; unknown where one is."""
    return None if ours is None or theirs is None else choose(ours, theirs)


def with_stated(estimate: MapObject, parts: Sequence[MapObject]) -> MapObject:
    """The object with the edits of its parts; of two edits of one value the first part's."""
    stated: dict[str, object] = {}
    for part in reversed(parts):
        stated |= {name: getattr(part, name) for word in part.corrected for name in CORRECTABLE[word]}
    words = tuple(word for word in CORRECTABLE if any(word in part.corrected for part in parts))
    return replace(estimate, corrected=words, **stated) if words else estimate
