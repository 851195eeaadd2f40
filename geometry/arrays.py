"""Array types used in most signatures, and what a covariance allows."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
CHI2_997 = 11.83  # squared Mahalanobis distance in the plane that holds 99.7 %: the one gate of all associations


def positive(matrix: Array, least: float = 0.0) -> Array:
    """The nearest symmetric matrix with no eigenvalue below `least`."""
    values, vectors = np.linalg.eigh((matrix + matrix.T) / 2.0)
    return (vectors * np.maximum(values, least)) @ vectors.T


def inverse(matrices: Array) -> Array:
    """Inverses of matrices (..., N, N), in double precision."""
    return np.asarray(np.linalg.inv(matrices), dtype=np.float64)
