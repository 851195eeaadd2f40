"""Wheel odometry: encoders with integer ticks, errors of the wheels' radius, and slip."""

from dataclasses import dataclass

import numpy as np

from edgemap.geometry.se2 import SE2
from edgemap.simulation.render.mesh import Array
from edgemap.simulation.robot.motion import SAMPLE_S, SampledDrive


@dataclass(frozen=True, slots=True)
class Wheels:
    """Two driven wheels and their errors, as standard deviations unless stated otherwise.

    tick_m: what one encoder tick covers. scale: of both wheels' radius (the air in the tyres); unlike: of either one's.
    base_scale: of the distance between them.
    creep: of each sample's travel, per sqrt(metre). slips_per_m: how often one wheel slips; it then turns up to
    slip_most (share) too far, for up to slip_s.
    """

    base_m: float = 0.28
    tick_m: float = 0.0004
    scale: float = 0.008
    unlike: float = 0.0015
    base_scale: float = 0.02
    creep: float = 0.006
    slips_per_m: float = 0.25
    slip_most: float = 0.2
    slip_s: float = 0.4


def wheel_odometry(
    motion: SampledDrive, stamps_s: Array, rng: np.random.Generator, wheels: Wheels | None = None
) -> Array:
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
    time = np.arange(len(samples)) * SAMPLE_S
    at = [np.interp(stamps_s, time, values) for values in (x, y, yaw)]
    return np.array([(stamp, *SE2(*row).vector()) for stamp, *row in zip(stamps_s, *at, strict=True)])


def _slip(amount: Array, rng: np.random.Generator, wheels: Wheels) -> Array:
    """How much further each wheel turns than it rolls, per sample (N, 2), 1 where it does not slip."""
    strain = 1.0 + 2.0 * (np.abs(amount[:, 1] - amount[:, 0]) > 0.3 * amount.sum(axis=1))
    starts = rng.random(amount.shape) < 0.5 * wheels.slips_per_m * amount * strain[:, None]
    slip = np.ones(amount.shape)
    for row, wheel in np.argwhere(starts):
        last = row + max(1, round(rng.uniform(0.1, wheels.slip_s) / SAMPLE_S))
        slip[row:last, wheel] = 1.0 + rng.uniform(0.05, wheels.slip_most)
    return slip
