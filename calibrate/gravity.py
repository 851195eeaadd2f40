"""The direction of gravity from an accelerometer, over all samples of a source."""

import numpy as np

from edgemap.geometry.arrays import Array
from edgemap.geometry.camera.imu import ImuSamples
from edgemap.geometry.camera.inertial import GRAVITY_M_S2

WINDOW_S = 0.5
FEWEST_WINDOWS = 4
WORST_M_S2 = 1.0  # by which a window's mean may differ from gravity; a sensor's offset is 0.7


def gravity(samples: ImuSamples) -> Array | None:
    """Up, (3,) unit vector of the optical frame: the median over half seconds; None where samples are too few.

    Its accuracy is `inertial.OFFSET_RAD`: at rest an accelerometer's offset cannot be separated from a tilt.
    """
    if not len(samples):
        return None
    window = ((samples.stamps_s - samples.stamps_s[0]) / WINDOW_S).astype(int)
    counts = np.bincount(window)
    means = np.stack([np.bincount(window, samples.accel_m_s2[:, axis]) for axis in range(3)], axis=1)
    means = means[counts > 0] / counts[counts > 0, None]
    size = np.linalg.norm(means, axis=1)
    means = means[np.abs(size - GRAVITY_M_S2) < WORST_M_S2]
    if len(means) < FEWEST_WINDOWS:
        return None
    middle = np.median(means, axis=0)
    return middle / np.linalg.norm(middle)
