"""Loop hypotheses: which landmarks in view are earlier ones. All pairings are weighed jointly."""

import math
from collections import Counter
from collections.abc import Generator, Sequence
from dataclasses import dataclass

import numpy as np

from edgemap.geometry.arrays import CHI2_997, Array

HYPOTHESES = 400  # at most; with more, half of the landmarks are weighed, those with fewest candidates


@dataclass(frozen=True, slots=True)
class LoopHypothesisRule:
    """When two landmarks are one object."""

    spacing_m2: float = 50.0  # floor area per object of a label; its inverse is the density of new objects
    certain: float = 0.9  # least posterior probability of a pairing
    same_m: float = 0.3  # pairings with landmarks nearer together than this count as one


@dataclass(frozen=True, slots=True)
class Pairing:
    """A landmark in view (row) that may be an earlier one."""

    now: int
    before: int


def certain_pairings(
    pairings: Sequence[Pairing], landmarks: Array, covariance: Array, rule: LoopHypothesisRule, supported: int = 0
) -> Generator[None, None, list[Pairing]]:
    """The certain pairings; none where there is only one, since nothing confirms it. Yields after every unit of work.

    landmarks: (L, 2) m; covariance: (2 L, 2 L) of all of them together, so that common errors (the robot's drift since)
    are separated from individual ones. supported: earlier pairings of landmarks now in view. Joint compatibility (Neira
    and Tardos 2001), but instead of the hypothesis with the most pairings the posterior of each pairing over all
    hypotheses counts: among twins none is certain.
    """
    pairings = _compatible(pairings, landmarks, covariance)
    if not pairings:
        return []
    tree = _Tree(pairings, landmarks, covariance, rule)
    while not (yield from tree.grown()):
        if not (pairings := _least_ambiguous(pairings)):
            return []
        tree = _Tree(pairings, landmarks, covariance, rule)
    weights = np.exp(np.array(tree.scores) - max(tree.scores))
    shares = np.zeros(len(pairings))
    for weight, chosen in zip(weights / weights.sum(), tree.hypotheses, strict=True):
        shares[list(chosen)] += weight
    accepted = _held(pairings, shares, landmarks, rule)
    return accepted if len(accepted) + supported > 1 else []


def _held(pairings: Sequence[Pairing], shares: Array, landmarks: Array, rule: LoopHypothesisRule) -> list[Pairing]:
    """The best pairing of each landmark in view, where it is certain together with those to the same position."""
    accepted: dict[int, Pairing] = {}
    for now in dict.fromkeys(pairing.now for pairing in pairings):
        rows = [row for row, pairing in enumerate(pairings) if pairing.now == now and pairing.before not in accepted]
        if not rows:
            continue
        best = pairings[max(rows, key=lambda row: float(shares[row]))]
        positions = landmarks[[pairings[row].before for row in rows]]
        alike = np.linalg.norm(positions - landmarks[best.before], axis=1) <= rule.same_m
        if shares[rows][alike].sum() >= rule.certain:
            accepted[best.before] = best
    return list(accepted.values())


def _least_ambiguous(pairings: Sequence[Pairing]) -> list[Pairing]:
    """The half of the landmarks in view with the fewest candidates; none where there is only one landmark."""
    candidates = Counter(pairing.now for pairing in pairings)
    kept = sorted(candidates, key=lambda now: candidates[now])[: len(candidates) // 2]
    return [pairing for pairing in pairings if pairing.now in kept]


def _compatible(pairings: Sequence[Pairing], landmarks: Array, covariance: Array) -> list[Pairing]:
    """Pairings that are within the gate individually."""
    now, before = (
        np.array([getattr(pairing, end) for pairing in pairings], dtype=np.intp) for end in ("now", "before")
    )
    blocks = covariance.reshape(len(landmarks), 2, len(landmarks), 2)
    covariances = blocks[now, :, now] + blocks[before, :, before] - blocks[now, :, before] - blocks[before, :, now]
    difference = (landmarks[now] - landmarks[before])[:, :, None]
    distances2 = (difference * np.linalg.solve(covariances, difference)).sum(axis=(1, 2))
    return [pairing for pairing, distance2 in zip(pairings, distances2, strict=True) if distance2 <= CHI2_997]


def _differences(pairings: Sequence[Pairing], landmarks: Array, covariance: Array) -> tuple[Array, Array]:
    """Offsets between the ends of P pairings, (2 P,), and their covariance, (2 P, 2 P)."""
    now, before = (np.array([getattr(pairing, end) for pairing in pairings]) for end in ("now", "before"))
    difference = (landmarks[now] - landmarks[before]).ravel()
    a, b = ((2 * end[:, None] + np.arange(2)).ravel() for end in (now, before))
    spread = covariance[np.ix_(a, a)] + covariance[np.ix_(b, b)] - covariance[np.ix_(a, b)] - covariance[np.ix_(b, a)]
    return difference, spread


class _Tree:
    """All hypotheses: each landmark in view is one of its candidates or new. scores: log-likelihood over all new."""

    def __init__(
        self, pairings: Sequence[Pairing], landmarks: Array, covariance: Array, rule: LoopHypothesisRule
    ) -> None:
        self._pairings, self._rule = pairings, rule
        self._branches: list[list[int]] = []
        for now in dict.fromkeys(pairing.now for pairing in pairings):
            self._branches.append([row for row, pairing in enumerate(pairings) if pairing.now == now])
        self._branches.sort(key=len)
        self.hypotheses: list[tuple[int, ...]] = []
        self.scores: list[float] = []
        self._nodes = 0
        self._difference, self._covariance = _differences(pairings, landmarks, covariance)

    def grown(self) -> Generator[None, None, bool]:
        """Whether all hypotheses were weighed."""
        return (yield from self._grow(0, (), 0.0, self._difference, self._covariance))

    def _grow(
        self, depth: int, chosen: tuple[int, ...], score: float, difference: Array, covariance: Array
    ) -> Generator[None, None, bool]:
        self._nodes += 1
        if self._nodes % (HYPOTHESES // 10) == 0:
            yield
        if len(self.scores) >= HYPOTHESES:
            return False
        if depth == len(self._branches):
            self.hypotheses.append(chosen)
            self.scores.append(score)
            return True
        taken = {self._pairings[row].before for row in chosen}
        for row in self._branches[depth]:
            if self._pairings[row].before in taken:
                continue
            pair = slice(2 * row, 2 * row + 2)
            factor = np.linalg.inv(covariance[pair, pair])
            distance2 = float(difference[pair] @ factor @ difference[pair])
            if distance2 > CHI2_997:
                continue
            density = math.sqrt(float(np.linalg.det(factor))) / (2.0 * math.pi) * self._rule.spacing_m2
            gain = covariance[:, pair] @ factor
            after = difference - gain @ difference[pair], covariance - gain @ covariance[pair]
            likelihood = score + math.log(density) - distance2 / 2.0
            if not (yield from self._grow(depth + 1, (*chosen, row), likelihood, *after)):
                return False
        return (yield from self._grow(depth + 1, chosen, score, difference, covariance))
