"""The best alignment of a map with the true objects: what is left of its errors when its origin, heading or scale is
not counted."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from edgemap.evaluation.objects import FOUND_M, TrueObject, distances_m, pairs_within, score_map, scored
from edgemap.geometry.map_object import MapObject

SHORTEST_M = 0.7  # two objects that are nearer to each other constrain the heading too little
LARGEST_SCALE = 2.0  # and its inverse: of a map with a usable guess of the height
REFINED = 30  # hypotheses that are refined, the best ones
ROUNDS = 10  # of pairing and fitting
LEAST_PAIRS = 5  # two pairs determine a similarity: fewer than three more say nothing about the scale
MAXIMUM_CORRESPONDENCES = 400  # of which every two are tried; more are left out, those of the commonest labels first
CHUNK = 2_000_000  # distances that are computed at once

Places = NDArray[np.complex128]  # x + iy, m


# Factor and shift: takes a point x + iy of the map to factor * (x + iy) + shift, m. A factor of length one is a rigid
# motion; 1 / abs(factor) is the size of the map over the true size.
Similarity = tuple[complex, complex]
IDENTITY: Similarity = (1.0, 0.0)


def aligned_figures(objects: Sequence[MapObject], truth: Sequence[TrueObject]) -> dict[str, Any]:
    """How good the shape of a map is: as `score_map`, after an alignment by the objects themselves.

    f1_aligned: F1 after the best rigid motion, which forgives the map's origin and heading. f1_scaled: after the best
    similarity, which forgives its scale too; neither is below F1 without alignment. scale: size of the map over the
    true size by that similarity, null where fewer than five pairs determine it. An alignment that is fitted to the
    objects flatters: a map with few objects, or a wrong one, gains by it.
    """
    (rigid, _), (similar, count) = (best_alignment(objects, truth, scales) for scales in (False, True))
    # As many pairs may be a smaller F1: objects near one that is not scored count as errors elsewhere.
    scores = [score_map(_moved(objects, by), truth)["f1"] for by in (IDENTITY, rigid, similar)]
    return {
        "f1_aligned": max((one for one in scores[:2] if one is not None), default=None),
        "f1_scaled": max((one for one in scores if one is not None), default=None),
        "scale": round(1.0 / abs(similar[0]), 4) if count >= LEAST_PAIRS else None,
    }


def _moved(objects: Sequence[MapObject], by: Similarity) -> list[MapObject]:
    """The objects at their new places, with their covariances as they were."""
    places = [by[0] * complex(*item.position_m) + by[1] for item in objects]
    return [replace(item, position_m=np.array([at.real, at.imag])) for item, at in zip(objects, places, strict=True)]


def best_alignment(objects: Sequence[MapObject], truth: Sequence[TrueObject], scales: bool) -> tuple[Similarity, int]:
    """The alignment under which most objects are found, and how many. scales: whether it may scale the map.

    Every two pairs of objects of one label give a hypothesis; the best are refined by least squares over the pairs
    within 0.5 m. The identity is one of them, so the result is never worse than no alignment. Of equal numbers the
    smallest squared error decides.
    """
    wanted = scored(truth)
    mapped: Places = np.array([complex(*item.position_m) for item in objects], dtype=np.complex128)
    true: Places = np.array([complex(item.x_m, item.y_m) for item in wanted], dtype=np.complex128)
    same = np.isfinite(distances_m(objects, wanted))
    best, rank = IDENTITY, (-1, 0.0)
    for fit in [best, *_hypotheses(mapped, true, same, scales)]:
        for _ in range(ROUNDS):
            placed = fit[0] * mapped + fit[1]
            i, j = pairs_within(np.where(same, np.abs(placed[:, None] - true), np.inf), FOUND_M)
            now = len(i), -float((np.abs(placed[i] - true[j]) ** 2).sum())
            if now > rank:
                best, rank = fit, now
            if len(i) < 2 or (fitted := _fitted(mapped[i], true[j], scales)) == fit:
                break
            fit = fitted
    return best, rank[0]


def _fitted(from_m: Places, to_m: Places, scales: bool) -> Similarity:
    """Least squares over pairs, closed form (Umeyama 1991, in the plane)."""
    centred = from_m - from_m.mean()
    product, extent = complex(np.vdot(centred, to_m)), float(np.vdot(centred, centred).real)
    if abs(product) == 0.0:
        return IDENTITY
    factor = product / (extent if scales else abs(product))
    length = abs(factor)
    factor *= min(max(length, 1.0 / LARGEST_SCALE), LARGEST_SCALE) / length
    return factor, complex(to_m.mean() - factor * from_m.mean())


def _hypotheses(a: Places, b: Places, same: NDArray[np.bool_], scales: bool) -> list[Similarity]:
    """The alignments by every two pairs of one label that lay most objects near one of their label."""
    i, j = np.nonzero(same)
    alike = same.sum(axis=1)[i] * same.sum(axis=0)[j]
    rarest = np.argsort(alike, kind="stable")[:MAXIMUM_CORRESPONDENCES]
    i, j = i[rarest], j[rarest]
    p, q = np.triu_indices(len(i), 1)
    along_a, along_b = a[i[q]] - a[i[p]], b[j[q]] - b[j[p]]
    length_a, length_b = np.abs(along_a), np.abs(along_b)
    fits = (i[p] != i[q]) & (j[p] != j[q]) & (np.minimum(length_a, length_b) >= SHORTEST_M)
    if scales:
        fits &= np.maximum(length_a, length_b) <= LARGEST_SCALE * np.minimum(length_a, length_b)
    else:
        fits &= np.abs(length_a - length_b) <= 2.0 * FOUND_M
    p, q = p[fits], q[fits]
    factors = along_b[fits] / along_a[fits]
    factors = factors if scales else factors / np.abs(factors)
    shifts = 0.5 * (b[j[p]] + b[j[q]] - factors * (a[i[p]] + a[i[q]]))
    scores = np.zeros(len(factors))
    for part in np.array_split(np.arange(len(factors)), 1 + len(factors) * same.size // CHUNK):
        placed = factors[part, None] * a + shifts[part, None]
        near = np.maximum(1.0 - (np.abs(placed[:, :, None] - b) / FOUND_M) ** 2, 0.0) * same
        scores[part] = np.minimum(*(near.max(axis=axis, initial=0.0).sum(axis=1) for axis in (2, 1)))
    order = np.argsort(-scores, kind="stable")[:REFINED]
    return [(complex(factors[row]), complex(shifts[row])) for row in order]
