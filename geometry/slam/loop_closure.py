"""Loop closure: searches a hypothesis, tests it on the complete graph, accepts it where it makes all observations more
likely, and revokes it where it no longer fits; a bounded unit of work per frame.
"""

import math
from collections.abc import Generator, Mapping, Sequence, Set

from edgemap.geometry.arrays import CHI2_997, Array
from edgemap.geometry.slam.loop_hypotheses import certain_pairings
from edgemap.geometry.slam.object_landmarks import Landmark
from edgemap.geometry.slam.pose_graph import PoseGraph, Snapshot
from edgemap.geometry.trajectory_correction import TrajectoryCorrection


def closure(graph: PoseGraph) -> Generator[None, None, TrajectoryCorrection | None]:
    """Links landmarks of one object and solves the graph; revokes links that do not fit. Yields after every unit of
    work; until the end no landmark and no keyframe may leave the graph. Returns the correction of the trajectory; None
    where no pose moves.
    """
    before, groups = dict(graph.links), graph.groups()
    in_view = {one.number for one in graph.in_view() if graph.is_likely(one) and one.keyframes}
    candidates = _candidates(graph, _unlinked(graph, groups, in_view), groups)
    at = graph.snapshot({root for _, root in candidates})
    new = (yield from _hypothesis(graph, at, candidates, groups, in_view)) if candidates else {}
    evidence = frozenset((*link, len(graph.landmarks[link[0]].keyframes)) for link in new.items())
    if evidence == graph.unlikely:
        new = {}
    if not graph.links and not new:
        return None
    after = yield from at.solved(graph.links)
    if new:
        closed = yield from at.solved(graph.links | new, start=after, iterations=8)
        # All measurements together must be more likely with the links: odometry at its stated covariance, observations
        # with the errors that they share, and the chance that an object stands there.
        by_chance = len(at.ties(new)) * math.log(graph.rule.hypotheses.spacing_m2)
        if closed.log_evidence - after.log_evidence + by_chance > 0.0:
            graph.links |= new
            after = closed
        else:
            graph.unlikely, new = evidence, {}
    if not graph.links:
        return None
    while bad := {later: chi2 for later, chi2 in at.link_chi2(graph.links, after).items() if chi2 > CHI2_997}:
        # All new ones if one of these does not fit, else the worst of the others.
        for number in list(new) if bad.keys() & new.keys() else [max(bad, key=lambda number: bad[number])]:
            graph.refused.add((number, graph.root(graph.links[number])))
            del graph.links[number]
        new = {number: first for number, first in new.items() if number in graph.links}
        after = yield from at.solved(graph.links)
    graph.accepted += len(graph.links) - len(before)
    yield
    covariances = yield from after.pose_covariances()
    return graph.correct(after, covariances, graph.links != before)


def _hypothesis(
    graph: PoseGraph,
    at: Snapshot,
    candidates: Sequence[tuple[Landmark, int]],
    groups: Mapping[int, list[Landmark]],
    in_view: Set[int],
) -> Generator[None, None, dict[int, int]]:
    """The links that are certain among all pairings, with room for a slip of the odometry."""
    before = yield from at.solved(graph.links, loose=True, iterations=2)
    row, _ = at.objects(graph.links)
    pairings = [(row[one.number], row[root]) for one, root in candidates if {one.number, root} <= row.keys()]
    supported = sum(len(groups[graph.root(number)]) > 1 for number in in_view)
    certain = yield from certain_pairings(
        pairings, before.landmarks, before.landmark_covariance, graph.rule.hypotheses, supported
    )
    name = list(row)
    return witnessed(graph, {name[now]: name[before] for now, before in certain})


def _unlinked(graph: PoseGraph, groups: Mapping[int, list[Landmark]], in_view: Set[int]) -> list[Landmark]:
    """Landmarks that are not linked to an earlier object yet: those in view, most sightings first, then those that left
    the view unlinked, the latest first, before they are dropped."""
    count = len(graph.trajectory)
    since = count // 2 if count >= graph.rule.keyframes.maximum else count
    candidates = [
        one
        for (one, *others) in groups.values()
        if not others and graph.is_likely(one) and (one.number in in_view or one.last >= since)
    ]
    candidates.sort(key=lambda one: (0, -one.sums.pictures) if one.number in in_view else (1, -one.last))
    return candidates[: graph.rule.maximum // 10]


def witnessed(graph: PoseGraph, proposed: Mapping[int, int]) -> dict[int, int]:
    """The links that are supported by links of other objects observed at about the same time; one object alone is no
    evidence, however often it was observed.
    """
    landmarks, slack = graph.landmarks, graph.rule.every
    linked = {number: graph.root(number) for number in (*graph.links, *graph.links.values())} | dict(proposed)

    def is_supported(number: int, root: int) -> bool:
        first, last = landmarks[number].first - slack, landmarks[number].last + slack
        near = {at for other, at in linked.items() if landmarks[other].first <= last and landmarks[other].last >= first}
        return len(near - {root}) > 0

    return {number: root for number, root in proposed.items() if is_supported(number, root)}


def _candidates(
    graph: PoseGraph, fresh: Sequence[Landmark], groups: Mapping[int, list[Landmark]]
) -> list[tuple[Landmark, int]]:
    """Landmarks with each earlier object that they may be: of the same label, not observed since, the nearest ones; of
    two in one place the one that was observed more often."""
    counts = {root: sum(one.sums.pictures for one in members) for root, members in groups.items()}
    likely = (root for root, members in groups.items() if any(graph.is_likely(one) for one in members))
    earlier = sorted(likely, key=lambda root: -counts[root])
    pairs: list[tuple[float, Landmark, int]] = []
    for landmark in fresh:
        chosen: list[Array] = []
        for root in earlier:
            at = graph.landmarks[root].position_m
            if (
                groups[root][0].label == landmark.label
                and max(member.last for member in groups[root]) < landmark.first
                and (landmark.number, root) not in graph.refused
                and not any(landmark.is_distinct(member) for member in groups[root])
                and all(math.hypot(*(at - other)) > graph.rule.hypotheses.same_m for other in chosen)
            ):
                chosen.append(at)
                pairs.append((math.hypot(*(landmark.position_m - at)), landmark, root))
    pairs.sort(key=lambda pair: (pair[0], pair[1].number, pair[2]))
    near = set(list(dict.fromkeys(root for _, _, root in pairs))[: graph.rule.maximum // 2])
    return sorted(
        ((landmark, root) for _, landmark, root in pairs if root in near),
        key=lambda pair: (-pair[0].sums.pictures, pair[1]),
    )
