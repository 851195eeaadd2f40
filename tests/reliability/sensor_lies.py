"""What lying sensors say: wheel poses and inertial samples, well formed and wrong from a stamp on."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.ndimage import gaussian_filter1d

from edgemap.geometry.camera.imu import ImuSamples
from edgemap.geometry.se2 import SE2
from edgemap.runtime.frames.trajectory import Trajectory
from reliability.demo_slam import DemoDrive

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Steps = Callable[[Array, Mask, np.random.Generator], Array]
NEVER = math.inf
GYRO_FULL_RAD_S, ACCEL_FULL_M_S2 = math.radians(250.0), 2.0 * 9.81  # of common sensors' smallest ranges


@dataclass(frozen=True, slots=True)
class Lie:
    """One sensor's. sensor: as faults name it; empty for the truth. since_s, until_s: of the drive."""

    name: str
    sensor: str
    since_s: float = 0.0
    until_s: float = NEVER
    steps: Steps | None = None
    samples: Callable[[ImuSamples, Mask], ImuSamples] | None = None

    def wheels(self, true: Trajectory, random: np.random.Generator) -> Trajectory:
        """Wheel poses with this lie. steps: motions (N, 3) from pose to pose, and which are lies (N,)."""
        if self.steps is None:
            return true
        motions = np.array([(a.inverse() @ b).vector() for a, b in zip(true.poses, true.poses[1:], strict=False)])
        ends_s = true.stamps_s[1:]
        lies = (ends_s > self.since_s) & (ends_s <= self.until_s)
        poses = [true.poses[0]]
        for motion in self.steps(motions, lies, random):
            poses.append(poses[-1] @ SE2(*motion))
        return Trajectory(true.stamps_s, tuple(poses))

    def imu(self, true: ImuSamples) -> ImuSamples:
        """Samples with this lie."""
        if self.samples is None:
            return true
        return self.samples(true, (true.stamps_s > self.since_s) & (true.stamps_s <= self.until_s))


def _scaled(*factors: float) -> Steps:
    def steps(motions: Array, lies: Mask, random: np.random.Generator) -> Array:
        return np.where(lies[:, None], motions * factors, motions)

    return steps


def _jumping(motions: Array, lies: Mask, random: np.random.Generator) -> Array:
    jumps = random.choice(np.flatnonzero(lies)[20:230], 4, replace=False)
    jumped = motions.copy()
    jumped[jumps, 2] += 2.5 * random.choice([-1.0, 1.0], 4)
    return jumped


def _gyro(change: Callable[[Array], Array]) -> Callable[[ImuSamples, Mask], ImuSamples]:
    def samples(true: ImuSamples, lies: Mask) -> ImuSamples:
        return replace(true, gyro_rad_s=np.where(lies[:, None], change(true.gyro_rad_s), true.gyro_rad_s))

    return samples


def _accel(change: Callable[[Array], Array]) -> Callable[[ImuSamples, Mask], ImuSamples]:
    def samples(true: ImuSamples, lies: Mask) -> ImuSamples:
        return replace(true, accel_m_s2=np.where(lies[:, None], change(true.accel_m_s2), true.accel_m_s2))

    return samples


WHEEL_LIES = (
    Lie("good wheels", ""),
    Lie("wheels frozen from 10 s", "wheel", 10.0, steps=_scaled(0.0, 0.0, 0.0)),
    Lie("wheels frozen from 5 to 12 s", "wheel", 5.0, 12.0, steps=_scaled(0.0, 0.0, 0.0)),
    Lie("heading jumps of 2.5 rad", "wheel", steps=_jumping),
    Lie("yaw sign reversed", "wheel", steps=_scaled(1.0, 1.0, -1.0)),
    Lie("yaw sign reversed from 8 s", "wheel", 8.0, steps=_scaled(1.0, 1.0, -1.0)),
    Lie("yaw 1.6 times", "wheel", steps=_scaled(1.0, 1.0, 1.6)),
    Lie("all reversed", "wheel", steps=_scaled(-1.0, -1.0, -1.0)),
    Lie("lengths 1.5 times", "wheel", steps=_scaled(1.5, 1.5, 1.0)),
    Lie("all 0.6 times", "wheel", steps=_scaled(0.6, 0.6, 0.6)),
)
GYRO_LIES = (
    Lie("good gyro", ""),
    Lie("gyro saturated", "gyro", samples=_gyro(lambda g: np.full_like(g, GYRO_FULL_RAD_S))),
    Lie("gyro saturated from 5 to 12 s", "gyro", 5.0, 12.0, samples=_gyro(lambda g: np.full_like(g, GYRO_FULL_RAD_S))),
    Lie("gyro frozen from 8 s", "gyro", 8.0, samples=_gyro(lambda g: np.zeros_like(g) + g[len(g) // 3])),
    Lie("gyro reversed", "gyro", samples=_gyro(lambda g: -g)),
    Lie("accelerometer saturated", "accelerometer", samples=_accel(lambda a: np.full_like(a, ACCEL_FULL_M_S2))),
)


def imu_of(demo: DemoDrive, random: np.random.Generator) -> ImuSamples:
    """What a BMI055 beside the lens measures on the drive's true poses."""
    from edgemap.simulation.robot.imu import ImuErrors, measured

    truth, mount = demo.camera.info.truth, demo.floor.mount
    if truth is None:
        raise ValueError("the demo has true poses")
    poses = np.array([pose.vector() for pose in truth.poses])
    poses[:, 2] = np.unwrap(poses[:, 2])
    path = CubicSpline(truth.stamps_s, gaussian_filter1d(poses, 1.0, axis=0, mode="nearest"))
    optical, arm = mount.rotation_base_optical(), mount.position_base_m()

    def lens(stamps_s: Array) -> tuple[Array, Array]:
        x, y, yaw = path(stamps_s).T
        c, s, zero = np.cos(yaw), np.sin(yaw), np.zeros_like(yaw)
        turned = np.stack(
            [np.stack([c, -s, zero], -1), np.stack([s, c, zero], -1), np.stack([zero, zero, zero + 1], -1)], 1
        )
        return turned @ optical, turned @ arm + np.stack([x, y, zero], -1)

    errors = ImuErrors()
    first_s, last_s = float(truth.stamps_s[0]), float(truth.stamps_s[-1])
    return measured(np.arange(first_s + 0.01, last_s, 1.0 / errors.rate_hz), lens, random, errors)
