"""Nodding of a robot: on its springs as it speeds up and brakes, and over thresholds and carpets."""

import math
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter1d

from edgemap.simulation.render.mesh import Array
from edgemap.simulation.robot.motion import SAMPLE_S, Sampled

_PROFILE_M = 0.005  # between two heights of the floor


@dataclass(frozen=True, slots=True)
class Nodding:
    """A small robot on soft wheels. pitch_per_accel, roll_per_accel: rad per m/s^2, once it has settled. rate_hz,
    damping: of its springs. base_m, track_m: between its front and rear, and its left and right wheels.

    thresholds_per_m, carpets_per_m: met along its path (not at places of the home). threshold_m, threshold_long_m:
    height and length. carpet_m, carpet_long_m, rough_m: thickness and length, and standard deviation of its pile.
    askew_m: how far the left wheels meet an edge before the right ones.
    """

    pitch_per_accel: float = 0.02
    roll_per_accel: float = 0.012
    rate_hz: float = 2.5
    damping: float = 0.3
    base_m: float = 0.24
    track_m: float = 0.28
    thresholds_per_m: float = 0.15
    threshold_m: tuple[float, float] = (0.005, 0.014)
    threshold_long_m: tuple[float, float] = (0.03, 0.08)
    carpets_per_m: float = 0.12
    carpet_m: tuple[float, float] = (0.004, 0.010)
    carpet_long_m: tuple[float, float] = (0.8, 2.5)
    rough_m: float = 0.0006
    askew_m: float = 0.04


def lean(tilt: Array) -> Array:
    """(3, 3), from axes of the tilted base to the level one's; tilt: roll, pitch and rise."""
    (sp, sr), (cp, cr) = np.sin(tilt[[1, 0]]), np.cos(tilt[[1, 0]])
    return np.array([[cp, sp * sr, sp * cr], [0.0, cr, -sr], [-sp, cp * sr, cp * cr]])


def nodding_of(motion: Sampled, seeds: tuple[int, ...], rule: Nodding | None = None) -> Sampled:
    """The tilts of a drive; a longer one of the same seeds begins with the shorter one's."""
    rule = rule or Nodding()
    steps = np.diff(motion.samples, axis=0, prepend=motion.samples[:1])
    heading = motion.samples[:, 2]
    speed = (steps[:, 0] * np.cos(heading) + steps[:, 1] * np.sin(heading)) / SAMPLE_S
    accel = gaussian_filter1d(np.gradient(speed, SAMPLE_S), 2.0, mode="nearest")
    pushed = np.column_stack([rule.roll_per_accel * speed * steps[:, 2] / SAMPLE_S, -rule.pitch_per_accel * accel])
    sprung = _sprung(pushed, rule)
    travelled = np.cumsum(np.abs(speed)) * SAMPLE_S
    profile = _profile(float(travelled[-1]) + 1.0, seeds, rule)
    places_m = np.arange(len(profile)) * _PROFILE_M
    askew = rule.askew_m * np.sin(travelled)  # now one side first, now the other
    front, rear = travelled + rule.base_m / 2.0, travelled - rule.base_m / 2.0
    left, right = (
        np.stack([np.interp(at + side * askew / 2.0, places_m, profile) for at in (front, rear)])
        for side in (1.0, -1.0)
    )
    rolled = (left - right).mean(axis=0) / rule.track_m
    pitched = ((left + right)[1] - (left + right)[0]) / 2.0 / rule.base_m
    risen = (left + right).mean(axis=0) / 2.0
    return Sampled(np.column_stack([sprung[:, 0] + rolled, sprung[:, 1] + pitched, risen]))


def _sprung(pushed: Array, rule: Nodding) -> Array:
    """What a damped spring makes of where it is pushed to, (N, 2)."""
    omega, out = math.tau * rule.rate_hz, np.zeros_like(pushed)
    at, speed, parts = np.zeros(2), np.zeros(2), 4
    for row, aim in enumerate(pushed):
        for _ in range(parts):  # semi-implicit Euler, steps of 5 ms
            speed = speed + SAMPLE_S / parts * (omega**2 * (aim - at) - 2.0 * rule.damping * omega * speed)
            at = at + SAMPLE_S / parts * speed
        out[row] = at
    return out


def _profile(length_m: float, seeds: tuple[int, ...], rule: Nodding) -> Array:
    """Heights of the floor every _PROFILE_M along the path."""
    profile = np.zeros(math.ceil(length_m / _PROFILE_M) + 1)
    kinds = (
        (rule.thresholds_per_m, rule.threshold_m, rule.threshold_long_m, 0.0),
        (rule.carpets_per_m, rule.carpet_m, rule.carpet_long_m, rule.rough_m),
    )
    for number, (per_m, high_m, long_m, rough_m) in enumerate(kinds):
        rng, at = np.random.default_rng([*seeds, number]), 0.5
        while (at := at + rng.exponential(1.0 / per_m)) < length_m:
            high, long = rng.uniform(*high_m), rng.uniform(*long_m)
            first, count = round(at / _PROFILE_M), max(round(long / _PROFILE_M), 1)
            pile = gaussian_filter1d(rng.normal(0.0, 1.0, count), 4.0) * rough_m * 3.0
            part = profile[first : first + count]
            part += (high + pile)[: len(part)]
            at += long
    return gaussian_filter1d(profile, 2.0)  # a wheel is round
