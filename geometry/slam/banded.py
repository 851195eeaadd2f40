"""Solves with a banded Cholesky factor for many right-hand sides: block by block, so that matrix products do the work.

LAPACK's routine takes one right-hand side at a time, and three times as long for two hundred of them.
"""

import numpy as np

from edgemap.geometry.arrays import Array

BLOCK = 24  # rows that are solved together


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
