"""Which things seen now are things seen before: every joint hypothesis weighed, never one pairing by itself."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class LoopHypothesisRule:
    """When two landmarks are one thing.

    gate: squared Mahalanobis distance of a pairing, given those already taken, at most. spacing_m2: floor that one
    thing of a label has to itself, so that a new one stands anywhere with one over it as density. certain: posterior
    probability that a pairing needs; pairings with landmarks nearer together than same_m count as one. least: pairings
    that must agree. most_now: things seen now that are weighed together, those seen most. most_hypotheses: with more,
    nothing is decided.
    """

    gate: float = 11.83
    spacing_m2: float = 50.0
    certain: float = 0.9
    same_m: float = 0.3
    least: int = 2
    most_now: int = 8
    most_hypotheses: int = 400


@dataclass(frozen=True, slots=True)
class Pairing:
    """A thing seen now (row of the landmarks) that may be one seen before. extra_m2: variance of their distance beside
    what the landmarks' covariance says: a thing looks another from another side."""

    now: int
    before: int
    extra_m2: float


def certain_pairings(
    pairings: Sequence[Pairing], landmarks: Array, covariance: Array, rule: LoopHypothesisRule, supported: int = 0
) -> list[Pairing]:
    """The pairings that hold with certainty, none where fewer than `rule.least` agree.

    landmarks: (L, 2) m; covariance: (2 L, 2 L) of all of them together, so that what they share (the robot's drift
    since) is told from what they do not. supported: pairings of things now in view that were found earlier. Joint
    compatibility (Neira and Tardos 2001), but instead of the hypothesis with the most pairings the posterior of each
    pairing over all hypotheses counts: among twins none is certain.
    """
    pairings = _compatible(pairings, landmarks, covariance, rule)
    if not pairings:
        return []
    tree = _Tree(pairings, landmarks, covariance, rule)
    if not tree.grown():
        return []
    weights = np.exp(np.array(tree.scores) - max(tree.scores))
    shares = np.zeros(len(pairings))
    for weight, chosen in zip(weights / weights.sum(), tree.hypotheses, strict=True):
        shares[list(chosen)] += weight
    found = _held(pairings, shares, landmarks, rule)
    return found if len(found) + supported >= rule.least else []


def _held(pairings: Sequence[Pairing], shares: Array, landmarks: Array, rule: LoopHypothesisRule) -> list[Pairing]:
    """The best pairing of each thing seen now, where it is certain together with those that say the same place."""
    found: dict[int, Pairing] = {}
    for now in dict.fromkeys(pairing.now for pairing in pairings):
        rows = [row for row, pairing in enumerate(pairings) if pairing.now == now and pairing.before not in found]
        if not rows:
            continue
        best = pairings[max(rows, key=lambda row: float(shares[row]))]
        places = landmarks[[pairings[row].before for row in rows]]
        alike = np.linalg.norm(places - landmarks[best.before], axis=1) <= rule.same_m
        if shares[rows][alike].sum() >= rule.certain:
            found[best.before] = best
    return list(found.values())


def _compatible(
    pairings: Sequence[Pairing], landmarks: Array, covariance: Array, rule: LoopHypothesisRule
) -> list[Pairing]:
    """Those within the gate by themselves."""
    kept = []
    for pairing in pairings:
        difference, spread = _differences([pairing], landmarks, covariance)
        if difference @ np.linalg.solve(spread, difference) <= rule.gate:
            kept.append(pairing)
    return kept


def _differences(pairings: Sequence[Pairing], landmarks: Array, covariance: Array) -> tuple[Array, Array]:
    """How far apart the ends of P pairings are, (2 P,), and the covariance of that, (2 P, 2 P)."""
    now, before = (np.array([getattr(pairing, end) for pairing in pairings]) for end in ("now", "before"))
    difference = (landmarks[now] - landmarks[before]).ravel()
    rows = [(2 * end[:, None] + np.arange(2)).ravel() for end in (now, before)]
    a, b = rows
    spread = covariance[np.ix_(a, a)] + covariance[np.ix_(b, b)] - covariance[np.ix_(a, b)] - covariance[np.ix_(b, a)]
    extra = np.repeat([pairing.extra_m2 for pairing in pairings], 2)
    return difference, spread + np.diag(extra)


class _Tree:
    """All hypotheses: each thing seen now is one of its candidates or new. scores: log-likelihood over all new."""

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
        self._difference, self._spread = _differences(pairings, landmarks, covariance)

    def grown(self) -> bool:
        """Whether all hypotheses were looked at."""
        return self._grow(0, (), 0.0, self._difference, self._spread)

    def _grow(self, depth: int, chosen: tuple[int, ...], score: float, difference: Array, spread: Array) -> bool:
        if len(self.scores) >= self._rule.most_hypotheses:
            return False
        if depth == len(self._branches):
            self.hypotheses.append(chosen)
            self.scores.append(score)
            return True
        taken = {self._pairings[row].before for row in chosen}
        for row in self._branches[depth]:
            if self._pairings[row].before in taken:
                continue
            own = slice(2 * row, 2 * row + 2)
            factor = np.linalg.inv(spread[own, own])
            distance2 = float(difference[own] @ factor @ difference[own])
            if distance2 > self._rule.gate:
                continue
            density = math.sqrt(float(np.linalg.det(factor))) / (2.0 * math.pi) * self._rule.spacing_m2
            gain = spread[:, own] @ factor
            after = difference - gain @ difference[own], spread - gain @ spread[own]
            if not self._grow(depth + 1, (*chosen, row), score + math.log(density) - distance2 / 2.0, *after):
                return False
        return self._grow(depth + 1, chosen, score, difference, spread)
