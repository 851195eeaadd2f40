"""Alignment of two maps: a rigid motion of the plane that matches objects of one label, and the grids.

Every two label-consistent correspondences whose mutual distances agree give a motion; the one that explains the most
objects is refined by weighted least squares, and where both maps have a grid, by the occupied cells. It is rejected
where chance explains it, or where a clearly different motion explains nearly as much.
"""

import math
from collections import Counter
from collections.abc import Generator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment
from scipy.special import bdtrc

from edgemap.geometry.arrays import CHI2_997, Array, inverse
from edgemap.geometry.errors import MapError
from edgemap.geometry.map_object import MapObject
from edgemap.geometry.registration.grid_overlap import Grids, fitted_grid
from edgemap.geometry.registration.hypotheses import SAME_PLACE_M, SAME_TURN_RAD, Places, best_modes, hypotheses
from edgemap.geometry.se2 import SE2, by_pose, wrap_angle

Pairs = tuple[tuple[int, int], ...]
Rows = NDArray[np.intp]

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
    distances. chi2: sum of their squared Mahalanobis distances. A stated pose is certain without any pairs."""

    pose_a_b: SE2
    covariance: Array = field(default_factory=lambda: np.zeros((3, 3)))
    pairs: Pairs = ()
    shared: int = 0
    rival: int = 0
    chance: float = 0.0
    rms_m: float = 0.0
    chi2: float = 0.0


def align(first: Sequence[MapObject], second: Sequence[MapObject], grids: Grids = (None, None)) -> Alignment:
    """Find the second map's place in the first one's frame. Raises AlignmentError where that is not certain."""
    work = Registration(first, second, grids=grids).aligning()
    try:
        for _ in range(5000):  # some ten seconds, for which somebody waits
            next(work)
    except StopIteration as end:
        return end.value
    raise AlignmentError(f"too many motions to try between {len(first)} and {len(second)} objects")


class Registration:
    """Registration of two maps. grids: of both; they are evidence as the objects are. counts: of their objects. shared:
    see `Alignment`."""

    def __init__(
        self,
        first: Sequence[MapObject],
        second: Sequence[MapObject],
        rule: AlignmentRule | None = None,
        grids: Grids = (None, None),
    ) -> None:
        self.first, self.second = Places.of(first), Places.of(second)
        self.rule, self.grids, self.counts = rule or AlignmentRule(), grids, (len(first), len(second))
        self.shared = (Counter(self.first.labels.tolist()) & Counter(self.second.labels.tolist())).total()

    @cached_property
    def _alike(self) -> NDArray[np.bool_]:
        """Which objects of both maps have one label."""
        return self.first.labels[:, None] == self.second.labels

    def aligning(self) -> Generator[None, None, Alignment]:
        """Aligns the maps as `align` does, and yields after every unit of work; each unit has bounded size. Where there
        are grids, two pairs suffice.

        Chance is counted a contrario (Moisan and Stival 2004): the number of motions tried, times the probability that
        as many of the other objects fall as near to one of their label at random.
        """
        (ours, theirs), rule, shared = self.counts, self.rule, self.shared
        if ours * theirs > MAXIMUM_PAIRS:
            raise AlignmentError(
                f"maps of {ours} and {theirs} objects are too large to compare: "
                f"{MAXIMUM_PAIRS:,} pairs of objects at most"
            )
        least = rule.least_pairs if None in self.grids else 2
        if shared < least:
            raise AlignmentError(
                f"the maps ({ours} and {theirs} objects) share {shared} objects by label, at least {least} are needed"
            )
        tried = hypotheses(self.first, self.second)
        yield
        modes, fits = (yield from best_modes(tried, self.first, self.second, rule.reach_m)), list[Alignment]()
        for mode in modes:
            yield
            if fit := self._refined(mode):
                fits.append(self._with_grid(fit, self._chance(fit, len(tried.yaw_rad))))
        yield
        if not fits:
            raise AlignmentError(f"no motion lays more than one of {shared} objects with a common label onto its like")
        weight = (lambda fit: len(fit.pairs)) if None in self.grids else _surprise
        best = max(fits, key=lambda fit: (weight(fit), -fit.chi2))
        rival = max((fit for fit in fits if self._differ(best, fit)), key=weight, default=None)
        summary = f"the best alignment explains {len(best.pairs)} of {shared} objects with a common label"
        if len(best.pairs) < least:
            raise AlignmentError(f"{summary}, at least {least} are needed")
        if best.chance > rule.chance:
            raise AlignmentError(
                f"{summary}, which maps of unrelated places would do {best.chance:.2g} times "
                f"(at most {rule.chance:g} is accepted)"
            )
        if rival and weight(rival) > rule.rival_share * weight(best):
            raise AlignmentError(
                f"ambiguous: {summary} ({_words(best.pose_a_b)}), and a clearly different one {len(rival.pairs)} "
                f"({_words(rival.pose_a_b)})"
            )
        return self._accepted(best, len(rival.pairs) if rival else 0)

    def realigned(self, alignment: Alignment) -> Alignment:
        """Updates an alignment of the maps as they were a little earlier. Raises AlignmentError where too few objects
        still match."""
        if fit := self._refined(alignment.pose_a_b):
            fit = self._with_grid(fit, alignment.chance)
        if fit is None or len(fit.pairs) < max(2, self.rule.rival_share * len(alignment.pairs)):
            raise AlignmentError(f"{len(alignment.pairs)} objects matched, and no longer do")
        return replace(alignment, pose_a_b=fit.pose_a_b, covariance=fit.covariance, pairs=fit.pairs)

    def aligned_near(self, guesses: Sequence[SE2]) -> Alignment:
        """Aligns the second map to the first one from a few guessed poses of the second map in the first map's frame.

        A prior guess is one hypothesis among few, while `align` tries thousands, so fewer objects confirm it. Chance is
        the number of guesses, times the probability that as many of the second map's objects fall onto one of their
        label at random, times that of the grids. Raises AlignmentError where no guess is certain.
        """
        fits = list[Alignment]()
        for guess in guesses:
            fit = self._refined(guess)
            if fit and math.hypot(fit.pose_a_b.x_m - guess.x_m, fit.pose_a_b.y_m - guess.y_m) <= self.rule.reach_m:
                near = float(self._probabilities(fit.pose_a_b).mean())
                chance = len(guesses) * float(bdtrc(len(fit.pairs) - 1, self.counts[1], near))
                fits.append(self._with_grid(fit, chance))
        best = min(fits, key=lambda fit: fit.chance, default=None)
        if best is None or best.chance > self.rule.chance:
            reason = f"by chance {best.chance:.2g} times" if best else "no two objects agree"
            raise AlignmentError(f"no guessed start fits ({reason}; at most {self.rule.chance:g} is accepted)")
        return self._accepted(best)

    def _refined(self, pose: SE2) -> Alignment | None:
        """Pair one to one and fit in turns until the pairs stay; None where fewer than two are left."""
        pairs, covariance = self._paired(pose), np.zeros((3, 3))
        for _ in range(10):
            if len(pairs) < 2:
                return None
            pose, covariance = self._fitted(pose, pairs)
            before, pairs = pairs, self._paired(pose)
            if pairs == before:
                break
        if len(pairs) < 2:
            return None
        chi2 = float(self._distances2(pose, *np.array(pairs).T).sum())
        covariance = covariance * max(1.0, chi2 / (2 * len(pairs) - 3))
        return Alignment(pose, covariance, pairs, self.shared, chi2=chi2)

    def _with_grid(self, fit: Alignment, chance: float) -> Alignment:
        """The fit with the chance of both; by the grids where these agree for certain."""
        if (grid := fitted_grid(self.grids, fit.pose_a_b)) is None:
            return replace(fit, chance=chance)
        pose, covariance, by_grid = grid
        if by_grid > self.rule.chance:
            return replace(fit, chance=chance * by_grid)
        pairs = self._paired(pose) or fit.pairs
        return replace(fit, pose_a_b=pose, covariance=covariance, pairs=pairs, chance=chance * by_grid)

    def _probabilities(self, pose: SE2) -> Array:
        """Probability of each object of the second map (N,) that it falls within the gate of one of its label at
        random."""
        rows, columns = np.nonzero(self._alike)
        spread = np.sqrt(np.linalg.det(self._covariances(pose, rows, columns)))
        gates_m2 = np.minimum(self.rule.reach_m**2, CHI2_997 * spread)
        areas_m2 = math.pi * np.bincount(columns, gates_m2, len(self.second.labels))
        span = np.ptp(self.first.positions_m, axis=0) + 1.0
        return np.minimum(areas_m2 / float(np.prod(span)), 1.0)

    def _chance(self, fit: Alignment, tried: int) -> float:
        """Expected number of motions between unrelated maps that explain as many objects as closely: the minimum over
        the number of nearest pairs that are compared."""
        probabilities = self._probabilities(fit.pose_a_b)
        distances2 = np.sort(self._distances2(fit.pose_a_b, *np.array(fit.pairs).T))
        probability = float(probabilities[probabilities > 0.0].mean())
        minimum = float(max(tried, 1))  # of the two objects that gave the motion
        others = self.shared - 2
        for rank, distance2 in enumerate(distances2[2:], start=3):
            near = min(1.0, probability * float(distance2) / CHI2_997)
            minimum = min(minimum, others * max(tried, 1) * float(bdtrc(rank - 3, others, near)))
        return minimum

    def _differ(self, one: Alignment, other: Alignment) -> bool:
        """Whether another motion is clearly a different one: of the pairs, and of where it lays the second map."""
        middle = self.second.positions_m.mean(axis=0)
        a, b = one.pose_a_b, other.pose_a_b
        apart_m = float(np.linalg.norm(a.apply(middle) - b.apply(middle)))
        if apart_m <= SAME_PLACE_M and abs(wrap_angle(a.yaw_rad - b.yaw_rad)) <= SAME_TURN_RAD:
            return False
        return 2 * len(set(other.pairs) & set(one.pairs)) < len(other.pairs)

    def _accepted(self, fit: Alignment, rival: int = 0) -> Alignment:
        """The result of an accepted motion."""
        rows, columns = np.array(fit.pairs).T
        misses_m2 = np.square(self.first.positions_m[rows] - fit.pose_a_b.apply(self.second.positions_m[columns]))
        return replace(fit, rival=rival, rms_m=math.sqrt(float(misses_m2.sum(axis=1).mean())))

    def _paired(self, pose: SE2) -> Pairs:
        """One-to-one pairs within gate and reach: most pairs first, then smallest distance."""
        apart_m = self.first.positions_m[:, None] - pose.apply(self.second.positions_m)
        rows, columns = np.nonzero(self._alike & (np.square(apart_m).sum(axis=2) <= self.rule.reach_m**2))
        distances2, far = self._distances2(pose, rows, columns), 1e3
        cost = np.full(self._alike.shape, far)
        cost[rows, columns] = np.where(distances2 <= CHI2_997, distances2, far)
        pairs = zip(*(ends.tolist() for ends in linear_sum_assignment(cost)), strict=True)
        return tuple(pair for pair in pairs if cost[pair] < far)

    def _distances2(self, pose: SE2, rows: Rows, columns: Rows) -> Array:
        """Squared Mahalanobis distances (K,) of objects of the first map from those of the second."""
        misses = (self.first.positions_m[rows] - pose.apply(self.second.positions_m[columns]))[:, :, None]
        return (misses * np.linalg.solve(self._covariances(pose, rows, columns), misses)).sum(axis=(1, 2))

    def _covariances(self, pose: SE2, rows: Rows, columns: Rows) -> Array:
        """Covariances (K, 2, 2) of the differences of their positions."""
        rotation = pose.rotation()
        return self.first.covariances_m2[rows] + (rotation @ self.second.covariances_m2 @ rotation.T)[columns]

    def _fitted(self, pose: SE2, pairs: Pairs) -> tuple[SE2, Array]:
        """Weighted least squares over all pairs (Gauss-Newton): the motion and its covariance."""
        rows, columns = np.array(pairs).T
        covariance, theirs_m = np.zeros((3, 3)), self.second.positions_m[columns]
        for _ in range(5):
            residuals = (self.first.positions_m[rows] - pose.apply(theirs_m))[:, :, None]
            wrt_pose = by_pose(theirs_m @ pose.rotation().T)
            weighted = wrt_pose.transpose(0, 2, 1) @ inverse(self._covariances(pose, rows, columns))
            information = (weighted @ wrt_pose).sum(axis=0)
            # Above what rounding takes: of objects a thousand kilometres off, 1e-9 would be lost in it.
            floor = max(1e-9, 1e-13 * float(np.trace(information)))
            covariance = inverse(information + floor * np.eye(3))
            step = covariance @ (weighted @ residuals).sum(axis=(0, 2))
            pose = SE2(*(pose.vector() + step))
            if np.abs(step).max() < 1e-9:
                break
        return pose, covariance


def _surprise(fit: Alignment) -> float:
    return max(-math.log(max(fit.chance, 1e-300)), 0.0)


def _words(pose: SE2) -> str:
    return f"x {pose.x_m:.2f} m, y {pose.y_m:.2f} m, yaw {math.degrees(pose.yaw_rad):.0f} deg"
