"""Which poses of a trajectory add least: those nearest to an earlier one."""

import numpy as np

from edgemap.geometry.arrays import Array


def nearest_earlier(poses: Array, excess: int) -> dict[int, int]:
    """Of poses (N, 3), x, y, yaw in order of time, `excess` that are nearest to an earlier one, a radian counting as a
    metre: the row of each, with the row of the pose that stands for it. The first poses of a place remain."""
    if excess <= 0:
        return {}
    difference = poses[:, None] - poses[None]
    difference[..., 2] = np.angle(np.exp(1j * difference[..., 2]))
    distance = np.linalg.norm(difference, axis=2)
    distance[np.triu_indices(len(poses))] = np.inf  # to earlier ones only
    into: dict[int, int] = {}
    for _ in range(excess):
        gone, kept = divmod(int(distance.argmin()), len(poses))
        distance[gone] = distance[:, gone] = np.inf
        into[gone] = kept
    return into
