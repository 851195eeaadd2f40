"""A drive as a graph: poses chained by odometry, landmarks seen from them, and the least squares over all of it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve, cho_solve_banded, cholesky_banded

Array = NDArray[np.float64]
Rows = NDArray[np.intp]

BAND = 5  # superdiagonals of the poses' own information: each is tied to its neighbour in the chain
STILL_M = 1e-5  # a round that moves nothing by more has settled


@dataclass(frozen=True, slots=True, eq=False)
class OdometryFactors:
    """K poses one after another. motions (K - 1, 3): measured from each to the next, (m, m, rad) in the earlier one's
    frame; information (K - 1, 3, 3) of them. first (3,): what is known of the first pose; first_information (3, 3)."""

    motions: Array
    information: Array
    first: Array
    first_information: Array


@dataclass(frozen=True, slots=True, eq=False)
class ObservationFactors:
    """N measurements of landmarks. pose, landmark (N,): rows of them; place_m (N, 2): in the pose's frame;
    information (N, 2, 2), in that frame too."""

    pose: Rows
    landmark: Rows
    place_m: Array
    information: Array


@dataclass(frozen=True, slots=True, eq=False)
class LandmarkPriors:
    """What is known of L landmarks before any look. place_m (L, 2), information (L, 2, 2): zero where nothing is."""

    place_m: Array
    information: Array


@dataclass(frozen=True, slots=True, eq=False)
class Solution:
    """poses (K, 3): x, y, yaw; landmarks (L, 2); both in the map frame. covariance (2 L, 2 L): of all landmarks
    together; last_covariance (3, 3): of the last pose. chi2 (N,): squared Mahalanobis length of each residual."""

    poses: Array
    landmarks: Array
    covariance: Array
    last_covariance: Array
    chi2: Array


def solve(
    poses: Array,
    landmarks: Array,
    chain: OdometryFactors,
    looks: ObservationFactors,
    known: LandmarkPriors,
    kernel: float = 9.0,
    rounds: int = 6,
) -> Solution:
    """Gauss-Newton from poses (K, 3) and landmarks (L, 2): the most likely drive, looks under a Cauchy kernel.

    kernel: squared residual at which a look weighs half. Poses are eliminated first: their part is banded, so the time
    grows with their number, and with its cube only for landmarks.
    """
    count, size = len(poses), 2 * len(landmarks)
    whole = _System(count, size)
    for _ in range(max(rounds, 1)):
        whole.clear()
        _add_first(whole, poses[0], chain)
        _add_motions(whole, poses, chain)
        chi2 = _add_looks(whole, poses, landmarks, looks, kernel)
        _add_known(whole, landmarks, known)
        step, steps, schur = whole.step()
        poses, landmarks = poses + step.reshape(-1, 3), landmarks + steps.reshape(-1, 2)
        if max(np.abs(step).max(initial=0.0), np.abs(steps).max(initial=0.0)) < STILL_M:
            break
    poses = np.column_stack([poses[:, :2], np.angle(np.exp(1j * poses[:, 2]))])
    covariance = cho_solve(schur, np.eye(size)) if size else np.zeros((0, 0))
    return Solution(poses, landmarks, covariance, whole.last_covariance(covariance), chi2)


class _System:
    """Normal equations: poses' band (6, 3 K), landmarks' blocks, what lies between, and the right-hand sides."""

    def __init__(self, count: int, size: int) -> None:
        self.band = np.zeros((BAND + 1, 3 * count))
        self.between = np.zeros((3 * count, size))
        self.corner = np.zeros((size, size))
        self.right, self.right_corner = np.zeros(3 * count), np.zeros(size)

    def clear(self) -> None:
        """Begin another round."""
        for part in (self.band, self.between, self.corner, self.right, self.right_corner):
            part.fill(0.0)

    def add_blocks(self, row: Rows, column: Rows, blocks: Array) -> None:
        """Blocks (N, 3, 3) of the poses' part, at pose rows and columns, column >= row; upper triangle kept."""
        i, j = np.broadcast_arrays(np.arange(3)[:, None], np.arange(3)[None])
        rows, columns = 3 * row[:, None, None] + i, 3 * column[:, None, None] + j
        upper = columns >= rows
        np.add.at(self.band, (BAND + rows[upper] - columns[upper], columns[upper]), blocks[upper])

    def step(self) -> tuple[Array, Array, tuple[Array, bool]]:
        """Steps of the poses and of the landmarks, and the factor of the landmarks' information without the poses."""
        self._factor = cholesky_banded(self.band)
        self._solved = cho_solve_banded((self._factor, False), np.column_stack([self.right, self.between]))
        own, tied = self._solved[:, 0], self._solved[:, 1:]
        if not self.corner.size:
            return own, np.zeros(0), (np.zeros((0, 0)), False)
        schur = cho_factor(self.corner - self.between.T @ tied)
        steps = cho_solve(schur, self.right_corner - self.between.T @ own)
        return own - tied @ steps, steps, schur

    def last_covariance(self, covariance: Array) -> Array:
        """Marginal covariance (3, 3) of the last pose."""
        ends = np.zeros((len(self.right), 3))
        ends[-3:] = np.eye(3)
        own = cho_solve_banded((self._factor, False), ends)[-3:]
        tied = self._solved[-3:, 1:]
        return own + tied @ covariance @ tied.T


def _add_first(whole: _System, first: Array, chain: OdometryFactors) -> None:
    row = np.array([0])
    whole.add_blocks(row, row, chain.first_information[None])
    off = first - chain.first
    whole.right[:3] -= chain.first_information @ [off[0], off[1], np.angle(np.exp(1j * off[2]))]


def _add_motions(whole: _System, poses: Array, chain: OdometryFactors) -> None:
    before, after = poses[:-1], poses[1:]
    c, s = np.cos(before[:, 2]), np.sin(before[:, 2])
    dx, dy = (after[:, :2] - before[:, :2]).T
    x, y = c * dx + s * dy, -s * dx + c * dy
    residual = np.column_stack([x, y, after[:, 2] - before[:, 2]]) - chain.motions
    residual[:, 2] = np.angle(np.exp(1j * residual[:, 2]))
    zero, one = np.zeros_like(c), np.ones_like(c)
    by_after = _stack([[c, s, zero], [-s, c, zero], [zero, zero, one]])
    by_before = _stack([[-c, -s, y], [s, -c, -x], [zero, zero, -one]])
    rows = np.arange(len(before))
    weighted = chain.information @ residual[:, :, None]
    for jacobian, at in ((by_before, rows), (by_after, rows + 1)):
        turned = jacobian.transpose(0, 2, 1)
        whole.add_blocks(at, at, turned @ chain.information @ jacobian)
        np.subtract.at(whole.right.reshape(-1, 3), at, (turned @ weighted)[:, :, 0])
    whole.add_blocks(rows, rows + 1, by_before.transpose(0, 2, 1) @ chain.information @ by_after)


def _add_looks(whole: _System, poses: Array, landmarks: Array, looks: ObservationFactors, kernel: float) -> Array:
    if not len(looks.pose):
        return np.zeros(0)
    pose = poses[looks.pose]
    c, s = np.cos(pose[:, 2]), np.sin(pose[:, 2])
    dx, dy = (landmarks[looks.landmark] - pose[:, :2]).T
    x, y = c * dx + s * dy, -s * dx + c * dy
    residual = np.column_stack([x, y]) - looks.place_m
    chi2 = np.einsum("ni,nij,nj->n", residual, looks.information, residual)
    information = looks.information / (1.0 + chi2 / kernel)[:, None, None]
    by_landmark = _stack([[c, s], [-s, c]])
    by_pose = _stack([[-c, -s, y], [s, -c, -x]])
    weighted = information @ residual[:, :, None]
    turned_pose, turned_landmark = by_pose.transpose(0, 2, 1), by_landmark.transpose(0, 2, 1)
    whole.add_blocks(looks.pose, looks.pose, turned_pose @ information @ by_pose)
    np.subtract.at(whole.right.reshape(-1, 3), looks.pose, (turned_pose @ weighted)[:, :, 0])
    np.subtract.at(whole.right_corner.reshape(-1, 2), looks.landmark, (turned_landmark @ weighted)[:, :, 0])
    rows = 3 * looks.pose[:, None, None] + np.arange(3)[:, None]
    columns = 2 * looks.landmark[:, None, None] + np.arange(2)
    np.add.at(whole.between, (rows, columns), turned_pose @ information @ by_landmark)
    corner = turned_landmark @ information @ by_landmark
    np.add.at(whole.corner, (columns.transpose(0, 2, 1), columns), corner)
    return chi2


def _add_known(whole: _System, landmarks: Array, known: LandmarkPriors) -> None:
    count = len(landmarks)
    rows = np.arange(count)
    corner = whole.corner.reshape(count, 2, count, 2)
    corner[rows, :, rows] += known.information
    whole.right_corner -= (known.information @ (landmarks - known.place_m)[:, :, None])[:, :, 0].ravel()


def _stack(rows: list[list[Array]]) -> Array:
    """(N, R, C) of R lists of C arrays (N,)."""
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def inverse(matrices: Array) -> Array:
    """Inverses of matrices (..., N, N), in double precision."""
    return np.asarray(np.linalg.inv(matrices), dtype=np.float64)
