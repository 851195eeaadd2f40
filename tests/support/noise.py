"""Pictures of noise: they show nothing, but nobody takes them for a covered lens or a frozen camera."""

import numpy as np


def noise(index: int, shape: tuple[int, ...] = (64, 64, 3)) -> np.ndarray:
    """The picture of this index, (H, W, 3) uint8."""
    return np.random.default_rng(index).integers(0, 255, shape, dtype=np.uint8)
