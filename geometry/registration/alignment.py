"""Alignment of two maps: a rigid motion of the plane that matches objects of one label, and the grids.

Every two label-consistent correspondences whose mutual distances agree give a motion; the one that explains the most
objects is refined by weighted least squares, and where both maps have a grid, by the occupied cells. It is rejected
where chance explains it, or where a clearly different motion explains nearly as much.
"""

import math
from collections.abc import Generator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import linear_sum_assignment
from scipy.special import bdtrc

from edgemap.geometry.arrays import CHI2_997, Array
from edgemap.geometry.errors import MapError
from edgemap.geometry.map_object import MapObject
from edgemap.geometry.registration.grid_overlap import Grids, fitted_grid
from edgemap.geometry.registration.hypotheses import SAME_PLACE_M, SAME_TURN_RAD, best_modes, hypotheses
from edgemap.geometry.se2 import SE2, wrap_angle

ROUNDS = 10  # of refinement, at most: it ends where the pairs stay
Pairs = tuple[tuple[int, int], ...]

UNITS_OF_WORK = 5000  # of one alignment that somebody waits for: some ten seconds
MAXIMUM_PAIRS = 1_000_000  # of objects of both maps: 1,000 each


class AlignmentError(MapError):
    """Two maps cannot be aligned with certainty; the message gives the reason with numbers."""


@dataclass(frozen=True, slots=True)
class AlignmentRule:
    """Acceptance criteria for two maps of one place."""

    reach_m: float = 1.0  # greatest distance of a pair of objects
    least_pairs: int = 4  # minimum number of pairs, where no grids are compared
    chance: float = 0.001  # greatest expected number of alignments as good as this one between unrelated maps
    # A clearly different alignment may explain at most this share of the best one's objects, or of minus the logarithm
    # of its chance where grids are compared; of maps that have changed since, more must still match.
    rival_share: float = 0.8


@dataclass(frozen=True, slots=True, eq=False)
class Alignment:
    """pose_a_b: takes the second map's points into the first map's frame; covariance: (3, 3) of it, additive in (x, y,
    yaw) of the first frame, m and rad. pairs: rows of objects in the first and the second map that are one object.
    shared: number of objects that could be pairs by their labels. rival: number of pairs of the next, clearly different
    alignment. chance: expected number of alignments as good as this one between unrelated maps. rms_m: of the pairs'
    distances."""

    pose_a_b: SE2
    covariance: Array
    pairs: Pairs
    shared: int
    rival: int
    chance: float
    rms_m: float

    @classmethod
    def exact(cls, pose_a_b: SE2) -> "Alignment":
        """A pose that is certain without any pairs."""
        return cls(pose_a_b, np.zeros((3, 3)), (), 0, 0, 0.0, 0.0)


def align(first: Sequence[MapObject], second: Sequence[MapObject], grids: Grids = (None, None)) -> Alignment:
    """Find the second map's place in the first one's frame. Raises AlignmentError where that is not certain."""
    work = aligning(first, second, grids=grids)
    try:
        for _ in range(UNITS_OF_WORK):
            next(work)
    except StopIteration as end:
        return end.value
    raise AlignmentError(f"too many motions to try between {len(first)} and {len(second)} objects")


def aligning(
    first: Sequence[MapObject],
    second: Sequence[MapObject],
    rule: AlignmentRule | None = None,
    grids: Grids = (None, None),
) -> Generator[None, None, Alignment]:
    """Aligns two maps as `align` does, and yields after every unit of work; each unit has bounded size. grids: of both
    maps; they are evidence as the objects are, and two pairs suffice.

    Chance is counted a contrario (Moisan and Stival 2004): the number of motions tried, times the probability that as
    many of the other objects fall as near to one of their label at random.
    """
    rule = rule or AlignmentRule()
    if len(first) * len(second) > MAXIMUM_PAIRS:
        raise AlignmentError(
            f"maps of {len(first)} and {len(second)} objects are too large to compare: "
            f"{MAXIMUM_PAIRS:,} pairs of objects at most"
        )
    shared, least = _shared(first, second), rule.least_pairs if None in grids else 2
    if shared < least:
        raise AlignmentError(
            f"the maps ({len(first)} and {len(second)} objects) share {shared} objects by label, "
            f"at least {least} are needed"
        )
    tried = hypotheses(first, second)
    yield
    modes, fits = (yield from best_modes(tried, first, second, rule.reach_m)), list[_Fit]()
    for mode in modes:
        yield
        if fit := _refined(mode, first, second, rule):
            chance = _chance(fit, first, second, shared, len(tried.yaw_rad), rule)
            fits.append(_with_grid(fit, grids, chance, first, second, rule))
    yield
    if not fits:
        raise AlignmentError(f"no motion lays more than one of {shared} objects with a common label onto its like")
    weight = (lambda fit: len(fit.pairs)) if None in grids else _surprise
    best = max(fits, key=lambda fit: (weight(fit), -fit.chi2))
    rivals = [fit for fit in fits if best.differs(fit, second)]
    rival = max(rivals, key=weight, default=None)
    summary = f"the best alignment explains {len(best.pairs)} of {shared} objects with a common label"
    if len(best.pairs) < least:
        raise AlignmentError(f"{summary}, at least {least} are needed")
    if best.chance > rule.chance:
        raise AlignmentError(
            f"{summary}, which maps of unrelated places would do {best.chance:.2g} times "
            f"(at most {rule.chance:g} is accepted)"
        )
    count = len(rival.pairs) if rival else 0
    if rival and weight(rival) > rule.rival_share * weight(best):
        raise AlignmentError(
            f"ambiguous: {summary} ({_words(best.pose)}), and a clearly different one {count} ({_words(rival.pose)})"
        )
    return _alignment(best, first, second, shared, count)


def _alignment(
    fit: "_Fit", first: Sequence[MapObject], second: Sequence[MapObject], shared: int, rival: int = 0
) -> Alignment:
    distances = [np.linalg.norm(first[i].position_m - fit.pose.apply(second[j].position_m)) for i, j in fit.pairs]
    rms_m = math.sqrt(float(np.mean(np.square(distances))))
    return Alignment(fit.pose, fit.covariance, fit.pairs, shared, rival, fit.chance, rms_m)


def realigned(
    alignment: Alignment,
    first: Sequence[MapObject],
    second: Sequence[MapObject],
    rule: AlignmentRule | None = None,
    grids: Grids = (None, None),
) -> Alignment:
    """Updates an alignment of maps that have changed a little since. Raises AlignmentError where too few objects still
    match."""
    rule = rule or AlignmentRule()
    if fit := _refined(alignment.pose_a_b, first, second, rule):
        fit = _with_grid(fit, grids, alignment.chance, first, second, rule)
    if fit is None or len(fit.pairs) < max(2, rule.rival_share * len(alignment.pairs)):
        raise AlignmentError(f"{len(alignment.pairs)} objects matched, and no longer do")
    return replace(alignment, pose_a_b=fit.pose, covariance=fit.covariance, pairs=fit.pairs)


def aligned_near(
    guesses: Sequence[SE2],
    first: Sequence[MapObject],
    second: Sequence[MapObject],
    rule: AlignmentRule | None = None,
    grids: Grids = (None, None),
) -> Alignment:
    """Aligns the second map to the first one from a few guessed poses of the second map in the first map's frame.

    A prior guess is one hypothesis among few, while `align` tries thousands, so fewer objects confirm it. Chance is the
    number of guesses, times the probability that as many of the second map's objects fall onto one of their label at
    random, times that of the grids. Raises AlignmentError where no guess is certain.
    """
    rule = rule or AlignmentRule()
    fits = list[_Fit]()
    for guess in guesses:
        fit = _refined(guess, first, second, rule)
        if fit and math.hypot(fit.pose.x_m - guess.x_m, fit.pose.y_m - guess.y_m) <= rule.reach_m:
            near = float(_probabilities(fit.pose, first, second, rule).mean())
            chance = len(guesses) * float(bdtrc(len(fit.pairs) - 1, len(second), near))
            fits.append(_with_grid(fit, grids, chance, first, second, rule))
    best = min(fits, key=lambda fit: fit.chance, default=None)
    if best is None or best.chance > rule.chance:
        reason = f"by chance {best.chance:.2g} times" if best else "no two objects agree"
        raise AlignmentError(f"no guessed start fits ({reason}; at most {rule.chance:g} is accepted)")
    return _alignment(best, first, second, _shared(first, second))


def _probabilities(pose: SE2, first: Sequence[MapObject], second: Sequence[MapObject], rule: AlignmentRule) -> Array:
    """Probability of each object of the second map (N,) that it falls within the gate of one of its label at random."""
    span = np.ptp([item.position_m for item in first], axis=0) + 1.0
    covariances, labels = np.array([ours.covariance_m2 for ours in first]), np.array([ours.label for ours in first])
    rotation, areas_m2 = pose.rotation(), list[float]()
    for theirs in second:
        alike = covariances[labels == theirs.label] + rotation @ theirs.covariance_m2 @ rotation.T
        gates_m2 = np.minimum(rule.reach_m**2, CHI2_997 * np.sqrt(np.linalg.det(alike)))
        areas_m2.append(math.pi * float(gates_m2.sum()))
    return np.minimum(np.array(areas_m2) / float(np.prod(span)), 1.0)


@dataclass(frozen=True, slots=True, eq=False)
class _Fit:
    """A refined motion. distances2: squared Mahalanobis distance of each pair; chi2: their sum. chance: see
    `Alignment`, with that of the grids."""

    pose: SE2
    covariance: Array
    pairs: Pairs
    distances2: Array
    chance: float = 1.0

    @property
    def chi2(self) -> float:
        return float(self.distances2.sum())

    def differs(self, other: "_Fit", second: Sequence[MapObject]) -> bool:
        """Whether another motion is clearly a different one: of the pairs, and of where it lays the second map."""
        middle = np.mean([item.position_m for item in second], axis=0)
        apart_m = float(np.linalg.norm(self.pose.apply(middle) - other.pose.apply(middle)))
        turn_rad = abs(wrap_angle(self.pose.yaw_rad - other.pose.yaw_rad))
        if apart_m <= SAME_PLACE_M and turn_rad <= SAME_TURN_RAD:
            return False
        return 2 * len(set(other.pairs) & set(self.pairs)) < len(other.pairs)


def _surprise(fit: _Fit) -> float:
    return max(-math.log(max(fit.chance, 1e-300)), 0.0)


def _with_grid(
    fit: _Fit, grids: Grids, chance: float, first: Sequence[MapObject], second: Sequence[MapObject], rule: AlignmentRule
) -> _Fit:
    """The fit with the chance of both; by the grids where these agree for certain."""
    grid = fitted_grid(grids, fit.pose)
    if grid is None or grid.chance > rule.chance:
        return replace(fit, chance=chance * (grid.chance if grid else 1.0))
    pairs = _paired(grid.pose, first, second, rule) or fit.pairs
    return replace(fit, pose=grid.pose, covariance=grid.covariance, pairs=pairs, chance=chance * grid.chance)


def _shared(first: Sequence[MapObject], second: Sequence[MapObject]) -> int:
    ours, theirs = ([item.label for item in objects] for objects in (first, second))
    return sum(min(ours.count(label), theirs.count(label)) for label in set(ours))


def _refined(pose: SE2, first: Sequence[MapObject], second: Sequence[MapObject], rule: AlignmentRule) -> _Fit | None:
    """Pair one to one and fit in turns until the pairs stay; None where fewer than two are left."""
    pairs, covariance = _paired(pose, first, second, rule), np.zeros((3, 3))
    for _ in range(ROUNDS):
        if len(pairs) < 2:
            return None
        pose, covariance = _fitted(pose, pairs, first, second)
        before, pairs = pairs, _paired(pose, first, second, rule)
        if pairs == before:
            break
    if len(pairs) < 2:
        return None
    distances2 = np.array([_distance2(pose, first[i], second[j]) for i, j in pairs])
    free = 2 * len(pairs) - 3
    return _Fit(pose, covariance * max(1.0, float(distances2.sum()) / free), pairs, distances2)


def _paired(pose: SE2, first: Sequence[MapObject], second: Sequence[MapObject], rule: AlignmentRule) -> Pairs:
    """One-to-one pairs within gate and reach: most pairs first, then smallest distance."""
    places = pose.apply(np.array([item.position_m for item in second]))
    far = 1e3
    cost = np.full((len(first), len(second)), far)
    for i, ours in enumerate(first):
        near = np.flatnonzero(((places - ours.position_m) ** 2).sum(axis=1) <= rule.reach_m**2)
        for j in near.tolist():
            if second[j].label == ours.label and (distance2 := _distance2(pose, ours, second[j])) <= CHI2_997:
                cost[i, j] = distance2
    rows, columns = linear_sum_assignment(cost)
    return tuple((int(i), int(j)) for i, j in zip(rows, columns, strict=True) if cost[i, j] < far)


def _distance2(pose: SE2, ours: MapObject, theirs: MapObject) -> float:
    difference = ours.position_m - pose.apply(theirs.position_m)
    return float(difference @ np.linalg.solve(_pair_covariance(pose, ours, theirs), difference))


def _pair_covariance(pose: SE2, ours: MapObject, theirs: MapObject) -> Array:
    rotation = pose.rotation()
    return ours.covariance_m2 + rotation @ theirs.covariance_m2 @ rotation.T


def _fitted(pose: SE2, pairs: Pairs, first: Sequence[MapObject], second: Sequence[MapObject]) -> tuple[SE2, Array]:
    """Weighted least squares over all pairs (Gauss-Newton): the motion and its covariance."""
    covariance = np.zeros((3, 3))
    for _ in range(5):
        information, vector = np.zeros((3, 3)), np.zeros(3)
        for i, j in pairs:
            residual = first[i].position_m - pose.apply(second[j].position_m)
            wrt_pose = jacobian(pose, second[j].position_m)
            weighted = wrt_pose.T @ np.linalg.inv(_pair_covariance(pose, first[i], second[j]))
            information += weighted @ wrt_pose
            vector += weighted @ residual
        # Above what rounding takes: of objects a thousand kilometres off, 1e-9 would be lost in it.
        floor = max(1e-9, 1e-13 * float(np.trace(information)))
        covariance = np.linalg.inv(information + floor * np.eye(3)).astype(np.float64)
        step = covariance @ vector
        pose = SE2(*(pose.vector() + step))
        if np.abs(step).max() < 1e-9:
            break
    return pose, covariance


def jacobian(pose_a_b: SE2, point_b_m: Array) -> Array:
    """Derivative (2, 3) of a point (2,) of frame b, transformed to frame a, by the motion's (x, y, yaw)."""
    rotated = pose_a_b.rotation() @ point_b_m
    return np.array([[1.0, 0.0, -rotated[1]], [0.0, 1.0, rotated[0]]])


def _chance(
    fit: _Fit, first: Sequence[MapObject], second: Sequence[MapObject], shared: int, tried: int, rule: AlignmentRule
) -> float:
    """Expected number of motions between unrelated maps that explain as many objects as closely: the minimum over the
    number of nearest pairs that are compared."""
    probabilities = _probabilities(fit.pose, first, second, rule)
    probability = float(probabilities[probabilities > 0.0].mean())
    minimum = float(max(tried, 1))  # of the two objects that gave the motion
    others = shared - 2
    for rank, distance2 in enumerate(np.sort(fit.distances2), start=1):
        if rank > 2:
            near = min(1.0, probability * float(distance2) / CHI2_997)
            minimum = min(minimum, others * max(tried, 1) * float(bdtrc(rank - 3, others, near)))
    return minimum


def _words(pose: SE2) -> str:
    return f"x {pose.x_m:.2f} m, y {pose.y_m:.2f} m, yaw {math.degrees(pose.yaw_rad):.0f} deg"
