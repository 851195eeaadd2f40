"""Loop hypotheses: which landmarks in view are earlier ones. All pairings are weighed jointly."""

import math
from collections import Counter
from collections.abc import Generator, Sequence
from dataclasses import dataclass

import numpy as np

from edgemap.geometry.arrays import CHI2_997, Array

Pairing = tuple[int, int]  # rows of a landmark in view, and of an earlier one that it may be

HYPOTHESES = 400  # at most; with more, half of the landmarks are weighed, those with fewest candidates


@dataclass(frozen=True, slots=True)
class LoopHypothesisRule:
    """When two landmarks are one object."""

    spacing_m2: float = 50.0  # floor area per object of a label; its inverse is the density of new objects
    certain: float = 0.9  # least posterior probability of a pairing
    same_m: float = 0.3  # pairings with landmarks nearer together than this count as one


def certain_pairings(
    pairings: Sequence[Pairing], landmarks: Array, covariance: Array, rule: LoopHypothesisRule, supported: int = 0
) -> Generator[None, None, list[Pairing]]:
    """The certain pairings; none where there is only one, since nothing confirms it. Yields after every unit of work.

    landmarks: (L, 2) m; covariance: (2 L, 2 L) of all of them together, so that common errors (the robot's drift since)
    are separated from individual ones. supported: earlier pairings of landmarks now in view. Joint compatibility (Neira
    and Tardos 2001), but instead of the hypothesis with the most pairings the posterior of each pairing over all
    hypotheses counts: among twins none is certain.
    """
    pairings, weighed = _compatible(pairings, landmarks, covariance), None
    while pairings and (weighed := (yield from _weighed(pairings, landmarks, covariance, rule))) is None:
        pairings = _least_ambiguous(pairings)
    if weighed is None:
        return []
    scores = np.array([score for _, score in weighed])
    weights, shares = np.exp(scores - scores.max()), np.zeros(len(pairings))
    for weight, (chosen, _) in zip(weights / weights.sum(), weighed, strict=True):
        shares[list(chosen)] += weight
    accepted = _held(pairings, shares, landmarks, rule)
    return accepted if len(accepted) + supported > 1 else []


def _held(pairings: Sequence[Pairing], shares: Array, landmarks: Array, rule: LoopHypothesisRule) -> list[Pairing]:
    """The best pairing of each landmark in view, where it is certain together with those to the same position."""
    accepted: dict[int, Pairing] = {}
    for now in dict.fromkeys(now for now, _ in pairings):
        rows = [row for row, (other, before) in enumerate(pairings) if other == now and before not in accepted]
        if not rows:
            continue
        _, best = pairings[max(rows, key=lambda row: float(shares[row]))]
        positions = landmarks[[pairings[row][1] for row in rows]]
        alike = np.linalg.norm(positions - landmarks[best], axis=1) <= rule.same_m
        if shares[rows][alike].sum() >= rule.certain:
            accepted[best] = now, best
    return list(accepted.values())


def _least_ambiguous(pairings: Sequence[Pairing]) -> list[Pairing]:
    """The half of the landmarks in view with the fewest candidates; none where there is only one landmark."""
    candidates = Counter(now for now, _ in pairings)
    kept = sorted(candidates, key=lambda now: candidates[now])[: len(candidates) // 2]
    return [pairing for pairing in pairings if pairing[0] in kept]


def _compatible(pairings: Sequence[Pairing], landmarks: Array, covariance: Array) -> list[Pairing]:
    """Pairings that are within the gate individually."""
    now, before = np.array(pairings, dtype=np.intp).reshape(-1, 2).T
    blocks = covariance.reshape(len(landmarks), 2, len(landmarks), 2)
    covariances = blocks[now, :, now] + blocks[before, :, before] - blocks[now, :, before] - blocks[before, :, now]
    difference = (landmarks[now] - landmarks[before])[:, :, None]
    distances2 = (difference * np.linalg.solve(covariances, difference)).sum(axis=(1, 2))
    return [pairing for pairing, distance2 in zip(pairings, distances2, strict=True) if distance2 <= CHI2_997]


def _weighed(
    pairings: Sequence[Pairing], landmarks: Array, covariance: Array, rule: LoopHypothesisRule
) -> Generator[None, None, list[tuple[tuple[int, ...], float]] | None]:
    """All hypotheses, in which each landmark in view is one of its candidates or new: rows of pairings, and the
    log-likelihood over all new. None where there are too many."""
    now, before = np.array(pairings).T
    branches = sorted((np.flatnonzero(now == one).tolist() for one in dict.fromkeys(now.tolist())), key=len)
    a, b = ((2 * end[:, None] + np.arange(2)).ravel() for end in (now, before))
    spread = covariance[np.ix_(a, a)] + covariance[np.ix_(b, b)] - covariance[np.ix_(a, b)] - covariance[np.ix_(b, a)]
    hypotheses = list[tuple[tuple[int, ...], float]]()
    # Depth in the tree, rows chosen so far, their log-likelihood, and all offsets with their covariance given these.
    nodes = [(0, tuple[int, ...](), 0.0, (landmarks[now] - landmarks[before]).ravel(), spread)]
    visited = 0
    while nodes:
        depth, chosen, score, difference, spread = nodes.pop()
        visited += 1
        if visited % (HYPOTHESES // 10) == 0:
            yield
        if len(hypotheses) >= HYPOTHESES:
            return None
        if depth == len(branches):
            hypotheses.append((chosen, score))
            continue
        nodes.append((depth + 1, chosen, score, difference, spread))
        taken = {pairings[row][1] for row in chosen}
        for row in reversed([row for row in branches[depth] if pairings[row][1] not in taken]):
            pair = slice(2 * row, 2 * row + 2)
            information = np.linalg.inv(spread[pair, pair])
            distance2 = float(difference[pair] @ information @ difference[pair])
            if distance2 > CHI2_997:
                continue
            density = math.sqrt(float(np.linalg.det(information))) / (2.0 * math.pi) * rule.spacing_m2
            gain = spread[:, pair] @ information
            after = difference - gain @ difference[pair], spread - gain @ spread[pair]
            nodes.append((depth + 1, (*chosen, row), score + math.log(density) - distance2 / 2.0, *after))
    return hypotheses
