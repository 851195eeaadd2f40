"""Motion of a differential drive: along a path, on the spot, in reverse, or standing, within its limits.

A move is samples (N, 3) of x, y in metres and yaw in radians (not wrapped), SAMPLE_S apart, from rest to rest, without
the pose it starts from.
"""

import math
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter1d

from edgemap.simulation.render.mesh import Array

SAMPLE_S = 0.02
# A motor's current does not jump: every schedule is rounded off with this kernel, cut at three of it.
_ROUNDED_S = 0.08


@dataclass(frozen=True, slots=True)
class Limits:
    """What the robot can do: its radius, the clearance that paths keep beyond it, speeds and accelerations."""

    radius_m: float = 0.18
    margin_m: float = 0.08
    speed_m_s: float = 0.55
    acceleration_m_s2: float = 0.5
    yaw_rate_rad_s: float = 0.9
    yaw_acceleration_rad_s2: float = 2.0


@dataclass(frozen=True, slots=True, eq=False)
class Sampled:
    """Three values every SAMPLE_S from time 0, (N, 3): of a drive x, y in metres and yaw in radians (not wrapped); of a
    base that nods roll and pitch (positive down) in radians, and rise in metres."""

    samples: Array

    def at(self, stamps_s: Array) -> Array:
        """(M, 3) at stamps (M,) in seconds; before the start the first, after the end the last."""
        time = np.arange(len(self.samples)) * SAMPLE_S
        return np.stack([np.interp(stamps_s, time, self.samples[:, axis]) for axis in range(3)], axis=-1)


def headings(path_m: Array, near_rad: float = 0.0) -> Array:
    """Heading on each step of a path (N, 2), unwrapped, the first within half a turn of `near_rad`, (N - 1,)."""
    steps = np.diff(path_m, axis=0)
    raw = np.unwrap(np.concatenate([[near_rad], np.arctan2(steps[:, 1], steps[:, 0])]))[1:]
    # The polyline's small kinks are none of the robot's.
    return gaussian_filter1d(raw, 3.0, mode="nearest")


def along(path_m: Array, start_yaw_rad: float, limits: Limits) -> Array:
    """Follow a path (N, 2) whose points lie close together; the robot must face its first heading already."""
    length = np.linalg.norm(np.diff(path_m, axis=0), axis=1)
    heading = headings(path_m, start_yaw_rad)
    travelled = np.concatenate([[0.0], np.cumsum(length)])
    middles = (travelled[1:] + travelled[:-1]) / 2.0
    curvature = np.gradient(heading, middles)
    bend = np.gradient(curvature, middles)
    # v k within the yaw rate, and v^2 dk/ds (the turn's own acceleration at even speed) within half of its limit.
    allowed = np.minimum(limits.speed_m_s, limits.yaw_rate_rad_s / np.maximum(np.abs(curvature), 1e-6)) ** 2
    allowed = np.minimum(allowed, 0.5 * limits.yaw_acceleration_rad_s2 / np.maximum(np.abs(bend), 1e-6))
    square = np.concatenate([[0.0], np.minimum(allowed[1:], allowed[:-1]), [0.0]])
    # v^2 grows by at most 2 a s along the path, and likewise from its end: running minima of v^2 - 2 a s.
    room = 2.0 * limits.acceleration_m_s2 * travelled
    square = np.minimum.accumulate(square - room) + room
    square = np.minimum.accumulate((square + room)[::-1])[::-1] - room
    speed = np.sqrt(np.maximum(square, 0.0))
    time = np.concatenate([[0.0], np.cumsum(2.0 * length / np.maximum(speed[1:] + speed[:-1], 1e-9))])
    at = _rounded(np.interp(np.arange(0.0, time[-1], SAMPLE_S), time, travelled), travelled[-1])
    x, y = (np.interp(at, travelled, path_m[:, axis]) for axis in range(2))
    return np.stack([x, y, np.interp(at, middles, heading)], axis=1)


def turn(pose: Array, angle_rad: float, limits: Limits) -> Array:
    """Turn on the spot, left for positive angles."""
    angles = _trapezium(abs(angle_rad), limits.yaw_rate_rad_s, limits.yaw_acceleration_rad_s2)
    return pose + np.sign(angle_rad) * angles[:, None] * np.array([0.0, 0.0, 1.0])


def straight(pose: Array, distance_m: float, limits: Limits) -> Array:
    """Straight on, or straight back for negative distances; half speed, as robots back up."""
    travelled = _trapezium(abs(distance_m), 0.5 * limits.speed_m_s, 0.7 * limits.acceleration_m_s2)
    ahead = np.array([math.cos(pose[2]), math.sin(pose[2]), 0.0])
    return pose + np.sign(distance_m) * travelled[:, None] * ahead


def stand(pose: Array, seconds: float) -> Array:
    """Samples of a robot that stands."""
    return np.tile(pose, (max(1, round(seconds / SAMPLE_S)), 1))


def _trapezium(length: float, speed: float, acceleration: float) -> Array:
    """Positions from rest to rest over a length, with a trapezium of speeds, every SAMPLE_S."""
    speed = min(speed, math.sqrt(length * acceleration))
    if speed <= 0.0:
        return np.zeros(0)
    ramp, total = speed / acceleration, length / speed + speed / acceleration
    time = np.arange(0.0, total, SAMPLE_S)
    early, late = np.minimum(time, ramp), np.maximum(time - (total - ramp), 0.0)
    covered = 0.5 * acceleration * early**2 + speed * np.maximum(time - ramp, 0.0) - 0.5 * acceleration * late**2
    return _rounded(covered, length)


def _rounded(schedule: Array, end: float) -> Array:
    """A schedule that starts at 0 and comes to rest at its end, rounded off and a little longer."""
    pad = math.ceil(3.0 * _ROUNDED_S / SAMPLE_S)
    padded = np.concatenate([np.zeros(pad), schedule, np.full(pad + 1, end)])
    smooth = gaussian_filter1d(padded, _ROUNDED_S / SAMPLE_S, mode="nearest", truncate=3.0)
    smooth[-1] = end
    return smooth[1:]
