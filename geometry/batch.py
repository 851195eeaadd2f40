"""The default clustering's batch version: all sightings at once, closest pairs first. The measure of the online one."""

from __future__ import annotations

import heapq

from edgemap.geometry.association import AssociationRule, Estimate, assign, mahalanobis2, may_merge
from edgemap.geometry.exclusion import without_overlaps
from edgemap.geometry.floor_map import MapObject
from edgemap.geometry.sighting import PlacedSighting

ROUNDS = 20  # of reassignment; it settles in a few


def batch_objects(frames: list[list[PlacedSighting]], rule: AssociationRule | None = None) -> list[MapObject]:
    """Agglomerate all sightings of a drive: the pair of clusters with the least squared Mahalanobis distance joins
    first, until none lies within the gate; clusters that hold boxes of one frame never join. Then, as in k-means, every
    frame's sightings go to the clusters that they fit best, one to one, and clusters that lie close and were never seen
    side by side join, until nothing changes.

    frames: sightings frame by frame. Ids count the clusters of each label by first sighting. O(n^2 log n).
    """
    rule = rule or AssociationRule()
    found: list[MapObject] = []
    labels = dict.fromkeys(placed.label for frame in frames for placed in frame)
    for label in labels:
        members = [(number, placed) for number, frame in enumerate(frames) for placed in frame if placed.label == label]
        clusters = _reassigned(_agglomerate(members, rule), members, rule)
        shown = [cluster for cluster in clusters if cluster.shows(rule)]
        shown.sort(key=lambda cluster: cluster.sums.first_seen_s)
        for number, cluster in enumerate(shown, start=1):
            position, covariance = cluster.position_m, cluster.covariance(rule)
            found.append(cluster.sums.as_object(f"{label}-{number}", label, position, covariance))
    return without_overlaps(found)


def _agglomerate(members: list[tuple[int, PlacedSighting]], rule: AssociationRule) -> list[Estimate]:
    clusters = {i: Estimate(placed) for i, (_, placed) in enumerate(members)}
    frames = {i: frozenset([number]) for i, (number, _) in enumerate(members)}
    heap: list[tuple[float, int, int]] = []

    def offer(i: int, j: int) -> None:
        if frames[i] & frames[j]:
            return
        difference = clusters[i].position_m - clusters[j].position_m
        if difference @ difference > rule.max_distance_m**2:
            return
        spread = clusters[i].own_covariance(rule) + clusters[j].own_covariance(rule)
        distance = mahalanobis2(difference, spread)
        if distance <= rule.gate:
            heapq.heappush(heap, (distance, i, j))

    for i in range(len(members)):
        for j in range(i):
            offer(i, j)
    next_key = len(members)
    while heap:
        _, i, j = heapq.heappop(heap)
        if i not in clusters or j not in clusters:
            continue
        joined = clusters.pop(i)
        joined.join(clusters.pop(j))
        clusters[next_key] = joined
        frames[next_key] = frames[i] | frames[j]
        for other in [key for key in clusters if key != next_key]:
            offer(next_key, other)
        next_key += 1
    return list(clusters.values())


def _reassigned(
    clusters: list[Estimate], members: list[tuple[int, PlacedSighting]], rule: AssociationRule
) -> list[Estimate]:
    frames: dict[int, list[PlacedSighting]] = {}
    for number, placed in members:
        frames.setdefault(number, []).append(placed)
    before: list[int | None] = []
    for _ in range(ROUNDS):
        centres = [cluster for cluster in clusters if cluster.sums.count >= rule.min_count]
        rows: list[int | None] = []
        fused: dict[int, Estimate] = {}
        seen: dict[int, set[int]] = {}
        for number, frame in frames.items():
            matches = assign(frame, centres, rule)
            rows += matches
            for placed, row in zip(frame, matches, strict=True):
                if row is None:
                    continue
                seen.setdefault(row, set()).add(number)
                if row in fused:
                    fused[row].add(placed)
                else:
                    fused[row] = Estimate(placed)
        clusters = _merged(fused, seen, rule)
        if rows == before:
            break
        before = rows
    return clusters


def _merged(clusters: dict[int, Estimate], frames: dict[int, set[int]], rule: AssociationRule) -> list[Estimate]:
    """Join what lies close and was never seen side by side, as the online map does."""
    kept: dict[int, Estimate] = {}
    for row in sorted(clusters):
        for other in kept:
            if not frames[row] & frames[other] and may_merge(clusters[row], kept[other], rule):
                kept[other].join(clusters[row])
                frames[other] |= frames[row]
                break
        else:
            kept[row] = clusters[row]
    return list(kept.values())
