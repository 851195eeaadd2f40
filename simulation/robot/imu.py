"""Sensors of a simulated robot: an IMU beside the lens, and wheel encoders, each with its errors."""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.ndimage import gaussian_filter1d

from edgemap.geometry.camera.imu import ImuSamples
from edgemap.geometry.camera.mount import Mount
from edgemap.geometry.se2 import SE2
from edgemap.simulation.render.mesh import Array
from edgemap.simulation.robot.motion import SAMPLE_S, Sampled
from edgemap.simulation.robot.nodding import lean


@dataclass(frozen=True, slots=True)
class Wheels:
    """Two driven wheels and their errors, as standard deviations unless stated otherwise.

    tick_m: what one encoder tick covers. scale: of both wheels' radius (the air in the tyres); unlike: of either one's.
    base_scale: of the distance between them.
    creep: of each sample's travel, per sqrt(metre). slips_per_m: how often one wheel slips; it then turns up to
    largest_slip (share) too far, for up to slip_s.
    """

    base_m: float = 0.28
    tick_m: float = 0.0004
    scale: float = 0.008
    unlike: float = 0.0015
    base_scale: float = 0.02
    creep: float = 0.006
    slips_per_m: float = 0.25
    largest_slip: float = 0.2
    slip_s: float = 0.4


def wheel_odometry(motion: Sampled, stamps_s: Array, rng: np.random.Generator, wheels: Wheels | None = None) -> Array:
    """Rows (stamp_s, x_m, y_m, yaw_rad), (N, 4), at stamps (N,): the wheels' own integrated pose, from the identity.

    A wheel slips on the floor more readily while it is turning against the other one.
    """
    wheels = wheels or Wheels()
    samples = motion.samples[: int(stamps_s[-1] / SAMPLE_S) + 2]
    steps = np.diff(samples, axis=0)
    forward = steps[:, 0] * np.cos(samples[:-1, 2]) + steps[:, 1] * np.sin(samples[:-1, 2])
    travel = forward[:, None] + 0.5 * wheels.base_m * steps[:, 2:] * np.array([-1.0, 1.0])
    amount = np.abs(travel)
    radii = 1.0 + rng.normal(0.0, wheels.scale) + rng.normal(0.0, wheels.unlike, 2)
    turned = travel * radii * _slip(amount, rng, wheels)
    turned += wheels.creep * np.sqrt(amount) * rng.normal(0.0, 1.0, travel.shape)
    ticks = np.floor(np.cumsum(turned, axis=0) / wheels.tick_m + rng.random(2))
    counted = np.diff(np.concatenate([np.zeros((1, 2)), ticks]), axis=0) * wheels.tick_m
    believed_base_m = wheels.base_m * (1.0 + rng.normal(0.0, wheels.base_scale))
    ahead, turn = counted.mean(axis=1), (counted[:, 1] - counted[:, 0]) / believed_base_m
    yaw = np.concatenate([[0.0], np.cumsum(turn)])
    middle = yaw[:-1] + turn / 2.0
    x, y = (np.concatenate([[0.0], np.cumsum(ahead * part(middle))]) for part in (np.cos, np.sin))
    poses = Sampled(np.stack([x, y, yaw], axis=1)).at(stamps_s)
    return np.array([(stamp, *SE2(*row).vector()) for stamp, row in zip(stamps_s, poses, strict=True)])


def _slip(amount: Array, rng: np.random.Generator, wheels: Wheels) -> Array:
    """How much further each wheel turns than it rolls, per sample (N, 2), 1 where it does not slip."""
    strain = 1.0 + 2.0 * (np.abs(amount[:, 1] - amount[:, 0]) > 0.3 * amount.sum(axis=1))
    starts = rng.random(amount.shape) < 0.5 * wheels.slips_per_m * amount * strain[:, None]
    slip = np.ones(amount.shape)
    for row, wheel in np.argwhere(starts):
        last = row + max(1, round(rng.uniform(0.1, wheels.slip_s) / SAMPLE_S))
        slip[row:last, wheel] = 1.0 + rng.uniform(0.05, wheels.largest_slip)
    return slip


GRAVITY_M_S2 = 9.80665
_MOMENT_S = 0.0025  # over which velocities are taken
_SMOOTH = 1.0  # samples; a path's small kinks are none of the robot's accelerations: 0.2 mm, 0.005 degrees a step


@dataclass(frozen=True, slots=True)
class ImuErrors:
    """Errors of an IMU; by default those of Bosch's BMI055 (in Intel's D435i and D455) by its datasheet.

    gyro_density rad/s/sqrt(Hz), accel_density m/s^2/sqrt(Hz): white noise. gyro_bias rad/s, accel_bias m/s^2 (70 mg):
    largest offset. gyro_walk rad/s^2/sqrt(Hz), accel_walk m/s^3/sqrt(Hz). scale, misaligned: standard deviations,
    relative and rad. late_s: standard deviation of the clock's offset against the camera's.
    """

    rate_hz: float = 200.0
    gyro_density: float = math.radians(0.014)
    accel_density: float = 150e-6 * GRAVITY_M_S2
    gyro_bias: float = math.radians(1.0)
    accel_bias: float = 0.070 * GRAVITY_M_S2
    gyro_walk: float = 2e-5
    accel_walk: float = 3e-4
    scale: float = 0.005
    misaligned: float = math.radians(0.3)
    late_s: float = 0.002


def imu_samples(
    motion: Sampled,
    tilts: Sampled | None,
    mount: Mount,
    until_s: float,
    rng: np.random.Generator,
    errors: ImuErrors | None = None,
) -> ImuSamples:
    """Samples from time 0 until a stamp, optical axes. tilts: of a base that nods, None for a level one."""
    errors = errors or ImuErrors()
    true_s = np.arange(0.0, until_s, 1.0 / errors.rate_hz)
    smooth = gaussian_filter1d(motion.samples, _SMOOTH, axis=0, mode="nearest")
    moved = CubicSpline(np.arange(len(smooth)) * SAMPLE_S, smooth)
    leaned = np.zeros_like(smooth) if tilts is None else gaussian_filter1d(tilts.samples, 1.0, axis=0)
    tilted = CubicSpline(np.arange(len(leaned)) * SAMPLE_S, leaned)
    optical, arm = mount.rotation_base_optical(), mount.position_base_m()

    def lens(stamps_s: Array) -> tuple[Array, Array]:
        at_s = np.maximum(stamps_s, 0.0)
        rotations, places = np.zeros((len(at_s), 3, 3)), np.zeros((len(at_s), 3))
        for row, ((x, y, yaw), tilt) in enumerate(zip(moved(at_s), tilted(at_s), strict=True)):
            c, s = math.cos(yaw), math.sin(yaw)
            turned = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]) @ lean(tilt)
            rotations[row], places[row] = turned @ optical, turned @ arm + [x, y, tilt[2]]
        return rotations, places

    return measured(true_s, lens, rng, errors)


def measured(
    true_s: Array, lens: Callable[[Array], tuple[Array, Array]], rng: np.random.Generator, errors: ImuErrors
) -> ImuSamples:
    """Samples at stamps (N,). lens: at stamps, the rotation (N, 3, 3) from optical to z-up axes and the place (N, 3) in
    metres, both smooth."""
    moments = [lens(true_s + shift) for shift in (-_MOMENT_S, 0.0, _MOMENT_S)]
    (before, at_before), (turned, at), (after, at_after) = moments
    between = before.transpose(0, 2, 1) @ after
    turns = 0.5 * (between - between.transpose(0, 2, 1))[:, [2, 0, 1], [1, 2, 0]]  # rotation vectors of small rotations
    rates = turns / (2.0 * _MOMENT_S)
    accelerations = (at_before - 2.0 * at + at_after) / _MOMENT_S**2
    forces = np.einsum("nij,ni->nj", turned, accelerations + [0.0, 0.0, GRAVITY_M_S2])
    late_s = rng.normal(0.0, errors.late_s)
    found = []
    for true, density, bias, walk in (
        (rates, errors.gyro_density, errors.gyro_bias, errors.gyro_walk),
        (forces, errors.accel_density, errors.accel_bias, errors.accel_walk),
    ):
        scale, misaligned = rng.normal(0.0, errors.scale, 3), rng.normal(0.0, errors.misaligned, (3, 3))
        axes = np.diag(1.0 + scale) + misaligned * (1.0 - np.eye(3))
        offset = rng.uniform(-bias, bias, 3)
        steps = rng.normal(0.0, 1.0, (len(true), 6))
        drift = np.cumsum(steps[:, 3:], axis=0) * walk / math.sqrt(errors.rate_hz)
        found.append(true @ axes.T + offset + drift + steps[:, :3] * density * math.sqrt(errors.rate_hz))
    return ImuSamples(true_s + max(late_s, 0.0), *found)
