"""Measurements of the poses in a window other than its tracks: gravity, height, gyro, wheels."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from edgemap.geometry.arrays import Array

Indices = NDArray[np.intp]

# Standard deviations from which on a gyro and the rolling of wheels lose their weight (Cauchy): a bias may be wrong,
# and a robot may drive sideways.
DENIED = 10.0


@dataclass(frozen=True, slots=True, eq=False)
class PoseFactors:
    """up (3,): direction of gravity's opposite in optical axes; up_rad: its standard deviation. edges (3,), edges_rad:
    the same by a room's edges, infinite where they show none. height_m: of the lens
    above the floor, configured or measured; height_sigma_m: its standard deviation, rise_m: of its change since the
    pose before. gyro (3, 3): rotation since the pose before, takes this one's optical directions into the earlier
    one's; gyro_rad: its standard deviation about each axis, infinite without a gyro. slip_m: standard deviation of the
    axle's motion across its chord since the pose before, infinite for what may not roll on wheels.
    """

    up: Array
    up_rad: float
    height_m: float
    height_sigma_m: float
    rise_m: float
    gyro: Array
    gyro_rad: float = np.inf
    slip_m: float = np.inf
    edges: Array = field(default_factory=lambda: np.zeros(3))
    edges_rad: float = np.inf

    def after(self, other: Self, turn: Array) -> Self:
        """These factors after the previous pose, which had the factors `other`, is removed. turn (3, 3): takes that
        pose's optical directions into this one's."""
        kept = self.edges_rad < np.inf
        return replace(
            self,
            gyro=other.gyro @ self.gyro,
            gyro_rad=float(np.hypot(self.gyro_rad, other.gyro_rad)),
            rise_m=float(np.hypot(self.rise_m, other.rise_m)),
            slip_m=self.slip_m + other.slip_m,
            edges=self.edges if kept else turn @ other.edges,
            edges_rad=self.edges_rad if kept else other.edges_rad,
        )


class FactorRows:
    """The factors of S poses as rows of a least-squares problem in six numbers for each pose: a rotation from the left
    and a displacement, both in world axes. lever_m (2,): of the axle from the lens, ahead and left."""

    def __init__(self, factors: Sequence[PoseFactors], lever_m: Array) -> None:
        self._lever_m, self._slip_weight = lever_m, 1.0 / np.array([f.slip_m for f in factors])
        self._gyro = np.array([f.gyro for f in factors])
        by_edges = np.array([(f.up_rad / f.edges_rad) ** 2 for f in factors])  # their weight over gravity's
        up = np.array([f.up for f in factors]) + by_edges[:, None] * [f.edges for f in factors]
        self._up = up / np.linalg.norm(up, axis=1, keepdims=True)
        self._height_m = np.array([f.height_m for f in factors])
        sigmas = [(f.up_rad, f.height_sigma_m, f.gyro_rad, f.rise_m) for f in factors]
        self._weights = 1.0 / np.array(sigmas).T
        self._weights[0] *= np.sqrt(1.0 + by_edges)

    def rows(self, rotation: Array, position: Array, poses: Indices, gaps: Indices) -> tuple[Array, Array]:
        """Whitened rows (K, 6 S) and residuals (K,) of gravity and height of some poses, and of what lies between some
        poses and those before. rotation (S, 3, 3), position (S, 3): of all poses."""
        count, indices, between, before = len(rotation), np.arange(len(poses)), np.arange(len(gaps)), gaps - 1
        up_weight, height_weight, gyro_weight, rise_weight = self._weights
        up = np.einsum("nij,nj->ni", rotation[poses], self._up[poses]) * up_weight[poses, None]
        level = np.zeros((len(poses), 3, count, 6))
        level[indices, 0, poses, 1], level[indices, 0, poses, 2] = up[:, 2], -up[:, 1]
        level[indices, 1, poses, 0], level[indices, 1, poses, 2] = -up[:, 2], up[:, 0]
        level[indices, 2, poses, 5] = height_weight[poses]
        high = (self._height_m[poses] - position[poses, 2]) * height_weight[poses]
        turned = rotation[before] @ self._gyro[gaps] @ rotation[gaps].transpose(0, 2, 1)
        twice = (turned - turned.transpose(0, 2, 1))[:, [2, 0, 1], [1, 2, 0]]
        residual = np.column_stack([twice, 2.0 * (position[before, 2] - position[gaps, 2])])
        weight = np.column_stack([*[gyro_weight[gaps]] * 3, rise_weight[gaps]])
        off_gyro = (twice * weight[:, :3] / 2.0) ** 2
        weight[:, :3] /= np.sqrt(1.0 + off_gyro.sum(axis=1) / DENIED**2)[:, None]
        gap = np.zeros((len(gaps), 4, count, 6))
        for row, column in enumerate((0, 1, 2, 5)):
            gap[between, row, gaps, column], gap[between, row, before, column] = weight[:, row], -weight[:, row]
        rows = [level.reshape(-1, 6 * count), gap.reshape(-1, 6 * count)]
        off = [np.column_stack([-up[:, :2], high]).ravel(), (residual * weight / 2.0).ravel()]
        if self._slip_weight[gaps].any():
            rolling, slipped = self._rolling(rotation, position, gaps)
            rows.append(rolling)
            off.append(slipped)
        return np.concatenate(rows), np.concatenate(off)

    def _rolling(self, rotation: Array, position: Array, gaps: Indices) -> tuple[Array, Array]:
        """Rows and residuals of the axle's motion across its chord, between some poses and those before."""
        before, count = gaps - 1, len(rotation)
        yaw = np.arctan2(rotation[:, 1, 2], rotation[:, 0, 2])
        c, s = np.cos(yaw), np.sin(yaw)
        ahead, left = self._lever_m
        arm = np.column_stack([c * ahead - s * left, s * ahead + c * left])
        moved = position[gaps, :2] + arm[gaps] - position[before, :2] - arm[before]
        middle = yaw[before] + ((yaw[gaps] - yaw[before] + np.pi) % (2.0 * np.pi) - np.pi) / 2.0
        c, s = np.cos(middle), np.sin(middle)
        along, across = c * moved[:, 0] + s * moved[:, 1], c * moved[:, 1] - s * moved[:, 0]
        weight = self._slip_weight[gaps]
        weight = weight / np.sqrt(1.0 + (across * weight / DENIED) ** 2)
        rows, indices = np.zeros((len(gaps), count, 6)), np.arange(len(gaps))
        for pose, sign in ((gaps, 1.0), (before, -1.0)):
            rows[indices, pose, 2] = sign * (c * arm[pose, 0] + s * arm[pose, 1]) - along / 2.0
            rows[indices, pose, 3], rows[indices, pose, 4] = -sign * s, sign * c
        return (rows * weight[:, None, None]).reshape(-1, 6 * count), -across * weight
