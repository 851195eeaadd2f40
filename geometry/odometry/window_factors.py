"""What is measured of the poses in a window beside its tracks: gravity, height, gyro, rolling, bounded acceleration."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from edgemap.geometry.arrays import Array
from edgemap.geometry.camera.mount import Mount
from edgemap.geometry.se2 import SE2

Indices = NDArray[np.intp]

SLIPS, DENIED = 3.0, 10.0  # standard deviations from which on rolling and a gyro lose their weight


@dataclass(frozen=True, slots=True, eq=False)
class BaseStep:
    """What is expected of the motion of a base on wheels since the pose before.

    moved: the expected motion. sigma_m, sigma_rad: standard deviation of each coordinate and of the yaw. across_m: of
    the lateral motion of a robot that rolls, infinite for one that slides.
    """

    moved: SE2
    sigma_m: float
    sigma_rad: float
    across_m: float

    def after(self, other: Self) -> Self:
        """This step, with the pose before removed, whose own was `other`."""
        return replace(
            self,
            moved=other.moved @ self.moved,
            sigma_m=self.sigma_m + other.sigma_m,
            sigma_rad=self.sigma_rad + other.sigma_rad,
            across_m=self.across_m + other.across_m,
        )


NO_STEP = BaseStep(SE2(), np.inf, np.inf, np.inf)


@dataclass(frozen=True, slots=True, eq=False)
class PoseFactors:
    """up (3,): direction of gravity's opposite in optical axes; up_rad: its standard deviation. height_m: of the lens
    above the floor, as it is given or measured; height_sigma_m: its standard deviation, rise_m: of its change since the
    pose before. gyro (3, 3): rotation since the pose before, takes this one's optical directions into the earlier
    one's; gyro_rad, heading_rad: its standard deviation about level axes and about the vertical one, infinite without a
    gyro and where the gyro's heading is left to others. base: what the base does, for a
    camera on wheels.
    """

    up: Array
    up_rad: float
    height_m: float
    height_sigma_m: float
    rise_m: float
    gyro: Array
    gyro_rad: float = np.inf
    heading_rad: float = np.inf
    base: BaseStep = NO_STEP

    def after(self, other: Self) -> Self:
        """These factors, with the pose before removed, whose own were `other`."""
        return replace(
            self,
            gyro=other.gyro @ self.gyro,
            gyro_rad=float(np.hypot(self.gyro_rad, other.gyro_rad)),
            heading_rad=float(np.hypot(self.heading_rad, other.heading_rad)),
            rise_m=float(np.hypot(self.rise_m, other.rise_m)),
            base=self.base.after(other.base),
        )


class FactorRows:
    """The factors of S poses as rows of a least-squares problem in six numbers for each pose: a rotation from the left
    and a displacement, both in world axes."""

    def __init__(self, factors: Sequence[PoseFactors], mount: Mount) -> None:
        self._lever = np.array([-mount.forward_m, -mount.left_m])
        self._up, self._gyro = np.array([f.up for f in factors]), np.array([f.gyro for f in factors])
        self._height_m = np.array([f.height_m for f in factors])
        steps = [f.base for f in factors]
        self._moved = np.array([step.moved.vector() for step in steps])
        sigmas = [(f.up_rad, f.height_sigma_m, f.gyro_rad, f.heading_rad, f.rise_m) for f in factors]
        self._weights = 1.0 / np.array(sigmas).T
        self._base_weights = 1.0 / np.array([(b.sigma_m, b.sigma_m, b.sigma_rad, b.across_m) for b in steps])
        self._on_wheels = bool((self._base_weights > 0.0).any())

    def rows(self, rotation: Array, position: Array, poses: Indices, gaps: Indices) -> tuple[Array, Array]:
        """Whitened rows (K, 6 S) and residuals (K,) of gravity and height of some poses, and of what lies between some
        poses and those before. rotation (S, 3, 3), position (S, 3): of all poses."""
        count, number, between = len(rotation), len(poses), len(gaps)
        own = np.arange(number)
        parts, off = [], []
        up_weight, height_weight, gyro_weight, heading_weight, rise_weight = self._weights
        up = np.einsum("nij,nj->ni", rotation[poses], self._up[poses]) * up_weight[poses, None]
        level = np.zeros((number, 3, count, 6))
        level[own, 0, poses, 1], level[own, 0, poses, 2] = up[:, 2], -up[:, 1]
        level[own, 1, poses, 0], level[own, 1, poses, 2] = -up[:, 2], up[:, 0]
        level[own, 2, poses, 5] = height_weight[poses]
        high = (self._height_m[poses] - position[poses, 2]) * height_weight[poses]
        parts.append(level.reshape(-1, 6 * count))
        off.append(np.column_stack([-up[:, :2], high]).ravel())
        if between:
            own, before = np.arange(between), gaps - 1
            turned = rotation[before] @ self._gyro[gaps] @ rotation[gaps].transpose(0, 2, 1)
            weight = np.column_stack([gyro_weight[gaps], gyro_weight[gaps], heading_weight[gaps], rise_weight[gaps]])
            apart = np.column_stack(
                [
                    turned[:, 2, 1] - turned[:, 1, 2],
                    turned[:, 0, 2] - turned[:, 2, 0],
                    turned[:, 1, 0] - turned[:, 0, 1],
                    2.0 * (position[before, 2] - position[gaps, 2]),
                ]
            )
            off_gyro = (apart[:, :3] * weight[:, :3] / 2.0) ** 2
            weight[:, :3] /= np.sqrt(1.0 + off_gyro.sum(axis=1) / DENIED**2)[:, None]  # its bias may be wrong (Cauchy)
            gap = np.zeros((between, 4, count, 6))
            for row, column in enumerate((0, 1, 2, 5)):
                gap[own, row, gaps, column], gap[own, row, before, column] = weight[:, row], -weight[:, row]
            parts.append(gap.reshape(-1, 6 * count))
            off.append((apart * weight / 2.0).ravel())
            if self._on_wheels:
                rows, residual = self._base_rows(rotation, position, gaps)
                parts.append(rows)
                off.append(residual)
        return np.concatenate(parts), np.concatenate(off)

    def _base_rows(self, rotation: Array, position: Array, gaps: Indices) -> tuple[Array, Array]:
        """Rows of the bases' motions: of the coordinates and the yaw, and of the motion across the chord."""
        count, number = len(rotation), len(gaps)
        own, before = np.arange(number), gaps - 1
        ahead = rotation[:, :, 2]
        yaw = np.arctan2(ahead[:, 1], ahead[:, 0])
        c, s = np.cos(yaw), np.sin(yaw)
        right, up = self._lever
        arm = np.column_stack([c * right - s * up, s * right + c * up])  # from the lens to the base, level
        swing = np.column_stack([-arm[:, 1], arm[:, 0]])
        axes = np.array([[c, s], [-s, c]]).transpose(2, 0, 1)[before]
        moved = np.empty((number, 3))
        base = position[:, :2] + arm
        moved[:, :2] = (axes @ (base[gaps] - base[before])[:, :, None])[..., 0]
        moved[:, 2] = (yaw[gaps] - yaw[before] + np.pi) % (2.0 * np.pi) - np.pi
        by = np.zeros((number, 4, 2, 6))  # by the pose before and this one
        by[:, :2, 0, 3:5], by[:, :2, 1, 3:5] = -axes, axes
        by[:, :2, 0, 2] = -(axes @ swing[before, :, None])[..., 0] + np.column_stack([moved[:, 1], -moved[:, 0]])
        by[:, :2, 1, 2] = (axes @ swing[gaps, :, None])[..., 0]
        by[:, 2, 0, 2], by[:, 2, 1, 2] = -1.0, 1.0
        c, s = np.cos(moved[:, 2] / 2.0), np.sin(moved[:, 2] / 2.0)
        along, across = c * moved[:, 0] + s * moved[:, 1], c * moved[:, 1] - s * moved[:, 0]
        c, s, along = c[:, None, None], s[:, None, None], along[:, None, None]
        by[:, 3] = c * by[:, 1] - s * by[:, 0] - along / 2.0 * by[:, 2]
        weight = self._base_weights[gaps]
        slid = across * weight[:, 3]
        weight[:, 3] /= np.sqrt(1.0 + (slid / SLIPS) ** 2)  # a robot may slide (Cauchy)
        off = np.column_stack([self._moved[gaps] - moved, -across]) * weight
        rows = np.zeros((number, 4, count, 6))
        by *= weight[:, :, None, None]
        rows[own, :, before], rows[own, :, gaps] = by[:, :, 0], by[:, :, 1]
        return rows.reshape(-1, 6 * count), off.ravel()
