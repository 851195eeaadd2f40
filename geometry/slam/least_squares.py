"""Trajectory and landmarks as one sparse least-squares problem."""

import math
from collections.abc import Generator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_array
from scipy.sparse.linalg import splu

from edgemap.geometry.arrays import Array
from edgemap.geometry.se2 import wrap_angles

Rows = NDArray[np.intp]


@dataclass(frozen=True, slots=True, eq=False)
class OdometryFactors:
    """Factors of a chain of K poses. motions (K - 1, 3): motion from each pose to the next, (m, m, rad), in the frame
    of the earlier pose. information (K - 1, 3, 3): of the motions. first (3,): prior of the first pose.
    first_information (3, 3): of this prior. gain: standard deviation of two relative scale errors, one of all
    translations and one of all rotations. headings (K,): compass yaw of each pose, rad. heading_information (K,):
    rad^-2, zero for a pose without a compass yaw."""

    motions: Array
    information: Array
    first: Array
    first_information: Array
    gain: float
    headings: Array
    heading_information: Array


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


@dataclass(frozen=True, eq=False)
class Solution:
    """The estimate. poses (K, 3): x, y, yaw, map frame. landmarks (L, 2): map frame. biases (3,): scale errors of the
    translations and rotations, and mount error, in standard deviations. log_evidence: log-likelihood of all
    measurements (Laplace approximation), up to a constant of the odometry."""

    poses: Array
    landmarks: Array
    biases: Array
    log_evidence: float
    _last: "_System"
    _problem: "Problem"

    @cached_property
    def landmark_covariance(self) -> Array:
        """Joint covariance of all landmarks, (2 L, 2 L), m^2."""
        first = self.poses.size
        return self._last.covariance(first, first + self.landmarks.size)

    def pose_covariances(self) -> Generator[None, None, Array]:
        """Covariances of the poses, (K, 3, 3), from the stated odometry covariances; loop closure adds none. Yields
        after each unit of work."""
        odometry = replace(self._problem.odometry, gain=0.0)
        gaussian = replace(self._problem, odometry=odometry, freedom=math.inf)
        stated = _System(gaussian, self.poses, self.landmarks, self.biases)
        blocks, together = list[Array](), 25  # poses: as long as an iteration
        yield
        for first in range(0, len(self.poses), together):
            count = min(together, len(self.poses) - first)
            covariance = stated.covariance(3 * first, 3 * (first + count)).reshape(count, 3, count, 3)
            blocks.append(covariance[np.arange(count), :, np.arange(count)])
            yield
        return np.concatenate(blocks)


@dataclass(frozen=True, slots=True, eq=False)
class Problem:
    """All factors of a drive. landmarks_m (L, 2): where the landmarks start, and where their priors are. priors (L, 2,
    2): information of these, zero for a landmark without one. kernel: squared residual at which the weight of an
    observation is one half (Cauchy). freedom: degrees of freedom of the odometry errors (Student's t), which allow for
    slip; infinite for Gaussian ones.
    """

    odometry: OdometryFactors
    observations: ObservationFactors
    landmarks_m: Array
    priors: Array
    kernel: float
    freedom: float


def solve(problem: Problem, poses: Array, biases: Array, iterations: int) -> Generator[None, None, Solution]:
    """Gauss-Newton iterations that start from poses (K, 3) and biases (3,). Yields after each iteration, whose time is
    bounded."""
    landmarks = problem.landmarks_m
    for _ in range(max(iterations, 1)):
        system = _System(problem, poses, landmarks, biases)
        step = system.step()
        at_poses, at_landmarks, of_biases = np.split(step, [poses.size, poses.size + landmarks.size])
        poses, landmarks = poses + at_poses.reshape(-1, 3), landmarks + at_landmarks.reshape(-1, 2)
        biases = biases + of_biases
        yield
        if system.gain(step) < 0.01:  # of log-likelihood, of which loop closure compares whole units
            break
    poses = np.column_stack([poses[:, :2], wrap_angles(poses[:, 2])])
    return Solution(poses, landmarks, biases, system.log_evidence(), system, problem)


class _System:
    """The problem linearised: whitened residuals, their sparse Jacobian, and the factorised normal equations. Unknowns:
    poses, landmarks, gains of the odometry (2), error of the mount."""

    def __init__(self, problem: Problem, poses: Array, landmarks: Array, biases: Array) -> None:
        self._landmark, self._bias = poses.size, poses.size + landmarks.size  # their first columns
        self._entries: list[tuple[Array, Rows, Rows]] = []  # values, rows and columns of the Jacobian
        self._residuals: list[Array] = []
        self._rows, self._cost = 0, 0.0
        self._add(biases[:, None], (self._bias + np.arange(3), np.ones((3, 1, 1))))
        self._add_odometry(problem.odometry, problem.freedom, poses, biases)
        self._add_observations(problem.observations, problem.kernel, poses, landmarks, biases)
        self._add_priors(problem, landmarks)
        values, rows, columns = (np.concatenate(part) for part in zip(*self._entries, strict=True))
        jacobian = csc_array((values, (rows, columns)), shape=(self._rows, self._bias + 3))
        self._gradient = -(jacobian.T @ np.concatenate(self._residuals))
        self._factor = splu((jacobian.T @ jacobian).tocsc(), "MMD_AT_PLUS_A", 0.0, options={"SymmetricMode": True})

    def step(self) -> Array:
        """The step of all unknowns."""
        return np.asarray(self._factor.solve(self._gradient), dtype=np.float64)

    def gain(self, step: Array) -> float:
        """Gain in log-likelihood by a step, for the linearised problem."""
        return 0.5 * float(self._gradient @ step)

    def log_evidence(self) -> float:
        """Log-likelihood of all factors, with all unknowns marginalised (Laplace approximation)."""
        return -self._cost - 0.5 * float(np.log(np.abs(self._factor.U.diagonal())).sum())

    def covariance(self, first: int, end: int) -> Array:
        """Joint covariance of some unknowns."""
        unit = np.zeros((self._bias + 3, end - first))
        unit[first:end] = np.eye(end - first)
        return np.asarray(self._factor.solve(unit)[first:end], dtype=np.float64)

    def _add(
        self, residual: Array, *blocks: tuple[Rows, Array], scale: float = math.inf, dimension: float = 0.0
    ) -> None:
        """Whitened residuals (N, D). blocks: first columns (N,) of some unknowns, and derivatives (N, D, C) by them.
        scale, dimension: of a density with heavy tails: the degrees of freedom and D (Student's t), or the squared
        residual at which a weight is one half and 0 (Cauchy); a normal one where the scale is infinite."""
        chi2, weight = (residual**2).sum(axis=1), np.ones(len(residual))
        if math.isfinite(scale):
            weight = np.sqrt((scale + dimension) / (scale + chi2))
            self._cost += 0.5 * (scale + dimension) * float(np.log1p(chi2 / scale).sum())
        else:
            self._cost += 0.5 * float(chi2.sum())
        rows = self._rows + np.arange(residual.size).reshape(*residual.shape, 1)
        for first, jacobian in blocks:
            columns = first[:, None, None] + np.arange(jacobian.shape[2])
            rows_of, columns_of = np.broadcast_arrays(rows, columns)
            weighted = jacobian * weight[:, None, None]
            self._entries.append((weighted.ravel(), rows_of.ravel(), columns_of.ravel()))
        self._residuals.append((residual * weight[:, None]).ravel())
        self._rows += residual.size

    def _add_odometry(self, odometry: OdometryFactors, freedom: float, poses: Array, biases: Array) -> None:
        count = len(poses)
        first = poses[:1] - odometry.first
        first[:, 2] = wrap_angles(first[:, 2])
        root, first = _whitened(odometry.first_information[None], first)
        self._add(first, (np.zeros(1, dtype=np.intp), root))
        weight = np.sqrt(odometry.heading_information)
        off = weight * wrap_angles(poses[:, 2] - odometry.headings)
        self._add(off[:, None], (3 * np.arange(count) + 2, weight[:, None, None]))
        x, y, by_before, by_after = _seen_from(poses[:-1], poses[1:, :2])
        by_gain = np.zeros((count - 1, 3, 2))
        by_gain[:, :2, 0] = -odometry.gain * odometry.motions[:, :2]
        by_gain[:, 2, 1] = -odometry.gain * odometry.motions[:, 2]
        residual = np.column_stack([x, y, poses[1:, 2] - poses[:-1, 2]]) - odometry.motions + by_gain @ biases[:2]
        residual[:, 2] = wrap_angles(residual[:, 2])
        turn = np.tile([0.0, 0.0, 1.0], (count - 1, 1, 1))
        by_before = np.concatenate([by_before, -turn], axis=1)
        by_after = np.concatenate([np.pad(by_after, ((0, 0), (0, 0), (0, 1))), turn], axis=1)
        root, residual = _whitened(odometry.information, residual)
        before, gains = 3 * np.arange(count - 1), np.full(count - 1, self._bias)
        blocks = (before, root @ by_before), (before + 3, root @ by_after), (gains, root @ by_gain)
        self._add(residual, *blocks, scale=freedom, dimension=3.0)

    def _add_observations(
        self, seen: ObservationFactors, kernel: float, poses: Array, landmarks: Array, biases: Array
    ) -> None:
        x, y, by_pose, by_landmark = _seen_from(poses[seen.pose], landmarks[seen.landmark])
        residual = np.column_stack([x, y]) + biases[2] * seen.bias_m - seen.position_m
        root, residual = _whitened(seen.information, residual)
        self._cost += _normalisation(seen.information)
        by_mount, mount = root @ seen.bias_m[:, :, None], np.full(len(x), self._bias + 2)
        blocks = (3 * seen.pose, root @ by_pose), (self._landmark + 2 * seen.landmark, root @ by_landmark)
        self._add(residual, *blocks, (mount, by_mount), scale=kernel)

    def _add_priors(self, problem: Problem, landmarks: Array) -> None:
        known = np.flatnonzero(problem.priors.any(axis=(1, 2)))
        information = problem.priors[known]
        root, residual = _whitened(information, (landmarks - problem.landmarks_m)[known])
        self._add(residual, (self._landmark + 2 * known, root))
        self._cost += _normalisation(information)
        self._cost -= len(landmarks) * math.log(2.0 * math.pi)  # of the integral over their positions


def _whitened(information: Array, residual: Array) -> tuple[Array, Array]:
    """Roots (N, D, D) of information, and residuals (N, D) multiplied by them: of unit variance."""
    root = np.asarray(np.linalg.cholesky(information).transpose(0, 2, 1), dtype=np.float64)
    return root, (root @ residual[:, :, None])[:, :, 0]


def _normalisation(information: Array) -> float:
    """Negative logarithm of the product of the normal densities' largest values, by their information (N, 2, 2)."""
    return float(np.log(2.0 * np.pi / np.sqrt(np.linalg.det(information))).sum())


def _seen_from(poses: Array, points_m: Array) -> tuple[Array, Array, Array, Array]:
    """Transforms points (N, 2) into the frames of poses (N, 3): x, y, and derivatives by pose (N, 2, 3) and point
    (N, 2, 2)."""
    c, s = np.cos(poses[:, 2]), np.sin(poses[:, 2])
    dx, dy = (points_m - poses[:, :2]).T
    x, y = c * dx + s * dy, -s * dx + c * dy
    by_pose, by_point = np.array([[-c, -s, y], [s, -c, -x]]), np.array([[c, s], [-s, c]])
    return x, y, np.moveaxis(by_pose, -1, 0), np.moveaxis(by_point, -1, 0)
