"""Middle, scatter and weights of values among which some are wrong."""

import numpy as np
from numpy.typing import ArrayLike

from edgemap.geometry.arrays import Array

CLEAR_SIGMAS = 3.29  # standard deviations that hold 99.9 % of a normal distribution: the one probability of all gates
HUBER = 1.345  # standard deviations beyond which a measurement loses weight (95 % efficiency: Huber 1981)
TUKEY = 4.6851  # standard deviations from which on one has none (95 % efficiency: Beaton and Tukey 1974)
ANNEALING = (3.0, 2.0, 1.0, 1.0, 1.0)  # factors on TUKEY, round by round, of an estimate whose start is coarse
ROUNDS = len(ANNEALING)  # of an estimate that is repeated from its last result
NORMAL = 1.4826  # standard deviation of a normal distribution over its median absolute deviation (Hampel 1974)
FEWEST = 4  # values: the median deviation of fewer is no measure
RAYLEIGH = float(np.sqrt(2.0 * np.log(2.0)))  # median length of a normal error in a plane, in standard deviations


def median_and_scatter(values: ArrayLike) -> tuple[Array, Array]:
    """Median of rows (N,) or (N, K), and the standard deviation of normal errors with the same scatter."""
    array = np.asarray(values, dtype=np.float64)
    middle = np.asarray(np.median(array, axis=0))
    return middle, NORMAL * np.asarray(np.median(np.abs(array - middle), axis=0))


def tukey(distance2: Array, limit: float = TUKEY) -> Array:
    """Tukey's weights of squared normalised residuals. limit: standard deviations from which on they are 0."""
    return tukey_root(distance2, limit) ** 2


def tukey_root(distance2: Array, limit: float = TUKEY) -> Array:
    """Square roots of Tukey's weights: what the rows of a least-squares problem are multiplied by."""
    return np.maximum(1.0 - distance2 / limit**2, 0.0)
