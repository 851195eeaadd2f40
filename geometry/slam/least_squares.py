"""Trajectory and landmarks as one sparse least-squares problem: banded poses, landmarks by Schur complement."""

import math
from collections.abc import Callable, Generator
from dataclasses import dataclass, field, fields, replace
from functools import cached_property, partial

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve, cholesky_banded
from scipy.sparse import csr_array

from edgemap.geometry.arrays import Array

Rows = NDArray[np.intp]

BAND = 5  # superdiagonals of the information of the poses: each pose is linked to its neighbours in the chain
CONVERGED = 0.01  # iterations end when a step gains less log-likelihood: loop closure compares whole units
BLOCK = 24  # rows that are solved together


@dataclass(frozen=True, slots=True, eq=False)
class OdometryFactors:
    """Factors of a chain of K poses. motions (K - 1, 3): motion from each pose to the next, (m, m, rad), in the frame
    of the earlier pose. information (K - 1, 3, 3): of the motions. first (3,): prior of the first pose.
    first_information (3, 3): of this prior. gains (2,): standard deviations of two relative scale errors, one of all
    translations and one of all rotations. headings (K,): compass yaw of each pose, rad. heading_information (K,):
    rad^-2, zero for a pose without a compass yaw. headings and heading_information may be empty."""

    motions: Array
    information: Array
    first: Array
    first_information: Array
    gains: tuple[float, float] = (0.0, 0.0)
    headings: Array = field(default_factory=lambda: np.zeros(0))
    heading_information: Array = field(default_factory=lambda: np.zeros(0))


@dataclass(frozen=True, slots=True, eq=False)
class ObservationFactors:
    """N observations of landmarks. pose, landmark (N,): row numbers. position_m (N, 2): in the frame of the pose.
    information (N, 2, 2): in the same frame. bias_m (N, 2): displacement by one standard deviation of the mount error,
    which all observations share."""

    pose: Rows
    landmark: Rows
    position_m: Array
    information: Array
    bias_m: Array


@dataclass(frozen=True, slots=True, eq=False)
class LandmarkFactors:
    """Priors of landmarks. prior_m (L, 2), information (L, 2, 2): zero without a prior."""

    prior_m: Array
    information: Array


@dataclass(frozen=True, eq=False)
class Solution:
    """The estimate. poses (K, 3): x, y, yaw, map frame. landmarks (L, 2): map frame. biases (3,): scale errors of the
    translations and rotations, and mount error, in standard deviations. chi2 (N,): squared Mahalanobis distance of each
    observation. log_evidence: log-likelihood of all measurements (Laplace approximation), up to a constant of the
    odometry."""

    poses: Array
    landmarks: Array
    biases: Array
    chi2: Array
    log_evidence: float
    _last: "_System"
    _stated: "Callable[[], _System]"

    @cached_property
    def landmark_covariance(self) -> Array:
        """Joint covariance of all landmarks, (2 L, 2 L), m^2."""
        return self._last.landmark_covariance()

    @cached_property
    def pose_covariances(self) -> Array:
        """Covariances of the poses, (K, 3, 3), from the stated odometry covariances. Loop closure adds none."""
        stated = self._stated()
        stated.step()
        return stated.pose_covariances()

    def state_covariances(self) -> None:
        """Computes `pose_covariances` now, as one unit of work."""
        _ = self.pose_covariances


@dataclass(frozen=True, slots=True, eq=False)
class Problem:
    """All factors of a drive. kernel: squared residual at which the weight of an observation is one half (Cauchy).
    freedom: degrees of freedom of the odometry errors (Student's t), which allow for slip; infinite for Gaussian ones.
    """

    odometry: OdometryFactors
    observations: ObservationFactors
    landmarks: LandmarkFactors
    kernel: float = 9.0
    freedom: float = math.inf


def solve(
    problem: Problem, poses: Array, landmarks: Array, biases: Array, iterations: int = 6
) -> Generator[None, None, Solution]:
    """Gauss-Newton iterations that start from poses (K, 3) and landmarks (L, 2). Yields after each iteration.

    The time of one iteration is bounded. Poses are eliminated first. Their part is banded, so the time is linear in
    the number of poses, and cubic only in the number of landmarks.
    """
    size, layout = 2 * len(landmarks), _Layout(problem, len(poses), len(landmarks))
    for _ in range(max(iterations, 1)):
        system = _System(problem, layout, poses, landmarks, biases)
        step, steps = system.step()
        poses, landmarks = poses + step.reshape(-1, 3), landmarks + steps[:size].reshape(-1, 2)
        biases = biases + steps[size:]
        yield
        if system.gain(step, steps) < CONVERGED:
            break
    poses = np.column_stack([poses[:, :2], np.angle(np.exp(1j * poses[:, 2]))])
    odometry = replace(problem.odometry, gains=(0.0, 0.0))
    gaussian = replace(problem, odometry=odometry, freedom=math.inf)
    stated = partial(_System, gaussian, layout, poses, landmarks, biases)
    return Solution(poses, landmarks, biases, system.chi2, system.log_evidence(), system, stated)


class _Layout:
    """Positions of the factors in the normal equations; they are the same in each iteration. Observations are sorted by
    pose."""

    def __init__(self, problem: Problem, poses: int, landmarks: int) -> None:
        seen = problem.observations
        self.size = 2 * landmarks + 3
        self.order = np.argsort(seen.pose, kind="stable")
        self.seen = ObservationFactors(*(getattr(seen, item.name)[self.order] for item in fields(seen)))
        self.by_landmark = np.argsort(self.seen.landmark, kind="stable")
        self.poses, self.pose_starts = np.unique(self.seen.pose, return_index=True)
        self.landmarks, self.landmark_starts = np.unique(self.seen.landmark[self.by_landmark], return_index=True)
        self.columns = _columns(self.landmarks, landmarks)
        rows = np.broadcast_to((3 * self.seen.pose[:, None] + np.arange(3))[:, :, None], (len(seen.pose), 3, 3))
        columns = np.broadcast_to(_columns(self.seen.landmark, landmarks)[:, None], (len(seen.pose), 3, 3))
        rows = np.concatenate([rows.ravel(), np.repeat(np.arange(3 * poses), 2)])
        columns = np.concatenate([columns.ravel(), np.tile([self.size - 3, self.size - 2], 3 * poses)])
        self.between_order = np.argsort(rows, kind="stable")
        self.between_columns = columns[self.between_order]
        self.between_starts = np.searchsorted(rows[self.between_order], np.arange(3 * poses + 1))


def _columns(landmark: Rows, landmarks: int) -> Rows:
    """Columns of the corner that an observation of a landmark has: position and the mount's error, (N, 3)."""
    return np.column_stack([2 * landmark, 2 * landmark + 1, np.full_like(landmark, 2 * landmarks + 2)])


class _System:
    """Normal equations: poses' band (6, 3 K), the coupling of poses and corner (sparse), and the corner, dense: all
    landmarks, the odometry's gains, the mount's."""

    def __init__(self, problem: Problem, layout: _Layout, poses: Array, landmarks: Array, biases: Array) -> None:
        self._poses, self._landmarks, self._biases = poses, landmarks, biases
        self._count, self._size, self._layout = len(poses), layout.size, layout
        self.rhs, self._diagonal = np.zeros((self._count, 3)), np.zeros((self._count, 3, 3))
        self.corner, self.rhs_corner = np.zeros((self._size, self._size)), np.zeros(self._size)
        at = np.arange(2 * len(landmarks), self._size)
        self.corner[at, at], self.rhs_corner[at] = 1.0, -biases
        self.cost = 0.5 * float(biases @ biases)
        self._add_odometry(problem.odometry, problem.freedom)
        self._add_observations(layout.seen, problem.kernel)
        self._add_landmarks(problem.landmarks)

    @property
    def chi2(self) -> Array:
        """Of each observation, in the problem's order."""
        chi2 = np.empty_like(self._chi2)
        chi2[self._layout.order] = self._chi2
        return chi2

    def step(self) -> tuple[Array, Array]:
        """Steps of the poses (3 K,) and of the corner (2 L + 1,)."""
        self._factor = cholesky_banded(self._band(), check_finite=False)
        solved = solve_banded(self._factor, np.column_stack([self.rhs.ravel(), self.between.toarray()]))
        alone, self._tied = solved[:, 0], solved[:, 1:]
        across = self.between.T @ solved
        self.schur = cho_factor(self.corner - across[:, 1:], check_finite=False)
        steps = cho_solve(self.schur, self.rhs_corner - across[:, 0], check_finite=False)
        return alone - self._tied @ steps, steps

    def gain(self, step: Array, steps: Array) -> float:
        """Gain in log-likelihood by a step of the poses and of the corner, for the linearised problem."""
        return 0.5 * float(self.rhs.ravel() @ step + self.rhs_corner @ steps)

    def log_evidence(self) -> float:
        """Log-likelihood of all factors, with all unknowns marginalised (Laplace approximation). Call `step` first."""
        factors = self._factor[BAND], np.diagonal(self.schur[0])
        return -self.cost - float(sum(np.log(factor).sum() for factor in factors))

    def landmark_covariance(self) -> Array:
        """Joint covariance of all landmarks, (2 L, 2 L), m^2. Call `step` first."""
        size = 2 * len(self._landmarks)
        return cho_solve(self.schur, np.eye(self._size), check_finite=False)[:size, :size]

    def pose_covariances(self) -> Array:
        """Marginal covariances of all poses, (K, 3, 3). Call `step` first.

        The sum of the selected inverse of the band (Takahashi; its factor is block bidiagonal) and of the part that
        the corner adds.
        """
        k, (i, j) = 3 * np.arange(self._count)[:, None, None], np.indices((3, 3))
        diagonal = np.where(j >= i, self._factor[np.minimum(BAND + i - j, BAND), k + j], 0.0)
        after = self._factor[BAND + i - j - 3, k[:-1] + 3 + j]
        marginal = inverse(diagonal)
        gain = marginal[:-1] @ after
        marginal = marginal @ marginal.transpose(0, 2, 1)
        for row in range(self._count - 2, -1, -1):
            marginal[row] += gain[row] @ marginal[row + 1] @ gain[row].T
        corner = cho_solve(self.schur, np.eye(self._size), check_finite=False)
        tied = self._tied.reshape(self._count, 3, -1)
        return marginal + (self._tied @ corner).reshape(tied.shape) @ tied.transpose(0, 2, 1)

    def _band(self) -> Array:
        """The information of the poses in LAPACK's upper band storage, (6, 3 K): one row for each diagonal."""
        band = np.zeros((BAND + 1, self._count, 3))
        i, j = np.triu_indices(3)
        band[BAND + i - j, :, j] = self._diagonal[:, i, j].T
        i, j = np.indices((3, 3)).reshape(2, -1)
        band[BAND - 3 + i - j, 1:, j] = self._coupling[:, i, j].T
        return band.reshape(BAND + 1, -1)

    def _add_odometry(self, odometry: OdometryFactors, freedom: float) -> None:
        self._diagonal[0] += odometry.first_information
        residual = self._poses[0] - odometry.first
        residual[2] = np.angle(np.exp(1j * residual[2]))
        self.rhs[0] -= odometry.first_information @ residual
        self.cost += 0.5 * float(residual @ odometry.first_information @ residual)
        if len(odometry.headings):
            off = np.angle(np.exp(1j * (self._poses[:, 2] - odometry.headings)))
            self._diagonal[:, 2, 2] += odometry.heading_information
            self.rhs[:, 2] -= odometry.heading_information * off
            self.cost += 0.5 * float(odometry.heading_information @ off**2)
        x, y, by_before, by_after = _seen_from(self._poses[:-1], self._poses[1:, :2])
        turn = self._poses[1:, 2] - self._poses[:-1, 2]
        by_gain = np.zeros((self._count - 1, 3, 2))
        by_gain[:, :2, 0] = -odometry.gains[0] * odometry.motions[:, :2]
        by_gain[:, 2, 1] = -odometry.gains[1] * odometry.motions[:, 2]
        residual = np.column_stack([x, y, turn]) - odometry.motions + by_gain @ self._biases[-3:-1]
        residual[:, 2] = np.angle(np.exp(1j * residual[:, 2]))
        zero, one = np.zeros((self._count - 1, 2, 1)), np.tile([0.0, 0.0, 1.0], (self._count - 1, 1, 1))
        by_before = np.concatenate([by_before, -one], axis=1)
        by_after = np.concatenate([np.concatenate([by_after, zero], axis=2), one], axis=1)
        chi2 = np.einsum("ni,nij,nj->n", residual, odometry.information, residual)
        information = odometry.information
        if math.isfinite(freedom):
            information = information * ((freedom + 3.0) / (freedom + chi2))[:, None, None]
            self.cost += 0.5 * (freedom + 3.0) * float(np.log1p(chi2 / freedom).sum())
        else:
            self.cost += 0.5 * float(chi2.sum())
        weighted = information @ residual[:, :, None]
        from_gain, gains = by_gain.transpose(0, 2, 1) @ information, slice(self._size - 3, self._size - 1)
        self.corner[gains, gains] += (from_gain @ by_gain).sum(axis=0)
        self.rhs_corner[gains] -= (from_gain @ residual[:, :, None]).sum(axis=0)[:, 0]
        between = np.zeros((self._count, 3, 2))
        between[:-1] += by_before.transpose(0, 2, 1) @ information @ by_gain
        between[1:] += by_after.transpose(0, 2, 1) @ information @ by_gain
        self._by_gain = between.reshape(3 * self._count, 2)
        for jacobian, at in ((by_before, slice(None, -1)), (by_after, slice(1, None))):
            transposed = jacobian.transpose(0, 2, 1)
            self._diagonal[at] += transposed @ information @ jacobian
            self.rhs[at] -= (transposed @ weighted)[:, :, 0]
        self._coupling = by_before.transpose(0, 2, 1) @ information @ by_after

    def _add_observations(self, seen: ObservationFactors, kernel: float) -> None:
        x, y, by_pose, by_landmark = _seen_from(self._poses[seen.pose], self._landmarks[seen.landmark])
        residual = np.column_stack([x, y]) + self._biases[-1] * seen.bias_m - seen.position_m
        self._chi2 = np.einsum("ni,nij,nj->n", residual, seen.information, residual)
        information = seen.information * self._robust(self._chi2, kernel)[:, None, None]
        self.cost += _normalisation(seen.information)
        by_corner = np.concatenate([by_landmark, seen.bias_m[:, :, None]], axis=2)
        weighted = information @ np.concatenate([by_corner, by_pose, residual[:, :, None]], axis=2)
        from_pose, from_corner = by_pose.transpose(0, 2, 1) @ weighted, by_corner.transpose(0, 2, 1) @ weighted
        layout = self._layout
        if len(x):
            poses = np.add.reduceat(from_pose[:, :, 3:], layout.pose_starts)
            self._diagonal[layout.poses] += poses[:, :, :3]
            self.rhs[layout.poses] -= poses[:, :, 3]
            sums = np.add.reduceat(from_corner[layout.by_landmark], layout.landmark_starts)
            rows, mount = layout.columns[:, :2], self._size - 1
            self.corner[rows[:, :, None], layout.columns[:, None]] += sums[:, :2, :3]
            self.corner[mount, rows] += sums[:, 2, :2]
            self.corner[mount, mount] += sums[:, 2, 2].sum()
            self.rhs_corner[rows] -= sums[:, :2, 6]
            self.rhs_corner[mount] -= sums[:, 2, 6].sum()
        values = np.concatenate([from_pose[:, :, :3].ravel(), self._by_gain.ravel()])[layout.between_order]
        places = layout.between_columns, layout.between_starts
        self.between = csr_array((values, *places), shape=(3 * self._count, self._size))

    def _robust(self, chi2: Array, kernel: float) -> Array:
        """Cauchy weights of residuals. Adds their cost to `cost`."""
        if not math.isfinite(kernel):
            self.cost += 0.5 * float(chi2.sum())
            return np.ones(len(chi2))
        self.cost += 0.5 * kernel * float(np.log1p(chi2 / kernel).sum())
        return 1.0 / (1.0 + chi2 / kernel)

    def _add_landmarks(self, factors: LandmarkFactors) -> None:
        count, residual = len(self._landmarks), self._landmarks - factors.prior_m
        at = 2 * np.arange(count)[:, None] + np.arange(2)
        self.corner[at[:, :, None], at[:, None]] += factors.information
        self.rhs_corner[: 2 * count] -= (factors.information @ residual[:, :, None]).ravel()
        self.cost += 0.5 * float(np.einsum("ni,nij,nj->", residual, factors.information, residual))
        self.cost += _normalisation(factors.information[factors.information.any(axis=(1, 2))])
        self.cost -= count * math.log(2.0 * math.pi)  # of the integral over its position


def _normalisation(information: Array) -> float:
    """Negative logarithm of the product of the normal densities' largest values, by their information (N, 2, 2)."""
    return float(np.log(2.0 * np.pi / np.sqrt(np.linalg.det(information))).sum())


def _seen_from(poses: Array, points_m: Array) -> tuple[Array, Array, Array, Array]:
    """Transforms points (N, 2) into the frames of poses (N, 3): x, y, and derivatives by pose (N, 2, 3) and point
    (N, 2, 2)."""
    c, s = np.cos(poses[:, 2]), np.sin(poses[:, 2])
    dx, dy = (points_m - poses[:, :2]).T
    x, y = c * dx + s * dy, -s * dx + c * dy
    return x, y, _stack([[-c, -s, y], [s, -c, -x]]), _stack([[c, s], [-s, c]])


def _stack(rows: list[list[Array]]) -> Array:
    """Stacks R lists of C arrays (N,) into matrices (N, R, C)."""
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def inverse(matrices: Array) -> Array:
    """Inverses of matrices (..., N, N), in double precision."""
    return np.asarray(np.linalg.inv(matrices), dtype=np.float64)


def solve_banded(factor: Array, rhs: Array) -> Array:
    """x of `U.T @ U @ x = rhs`. factor: (D + 1, N), U as `scipy.linalg.cholesky_banded` gives it, with D
    superdiagonals, at most BLOCK; rhs: (N, M). Returns (N, M)."""
    above, size = len(factor) - 1, factor.shape[1]
    starts = range(0, size, BLOCK)
    i, j = np.indices((BLOCK, BLOCK + above))
    inside = (j >= i) & (j <= i + above)
    padded = np.concatenate([factor, np.zeros((above + 1, BLOCK + above))], axis=1)
    padded[above, size:] = 1.0
    columns = np.arange(0, size, BLOCK)[:, None, None] + j
    blocks = np.where(inside, padded[np.clip(above + i - j, 0, above), columns], 0.0)
    diagonal, above_diagonal = np.linalg.inv(blocks[:, :, :BLOCK]), blocks[:, BLOCK - above :, BLOCK:]
    solved = np.zeros((len(starts) * BLOCK + above, rhs.shape[1]))
    solved[:size] = rhs
    for block, at in enumerate(starts):
        end = at + BLOCK
        solved[at:end] = diagonal[block].T @ solved[at:end]
        solved[end : end + above] -= above_diagonal[block].T @ solved[end - above : end]
    for block, at in reversed(list(enumerate(starts))):
        end = at + BLOCK
        solved[end - above : end] -= above_diagonal[block] @ solved[end : end + above]
        solved[at:end] = diagonal[block] @ solved[at:end]
    return solved[:size]
