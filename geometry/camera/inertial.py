"""Attitude from gyro and accelerometer: an error-state Kalman filter, one update a frame.

The accelerometer tells gravity only as far as the camera's own acceleration averages out, which a bounded velocity
makes certain: the filter integrates the velocity that its attitude implies and holds it to zero, as loosely as robots
move. A wrong tilt makes gravity leak into that velocity and is found by it. States: attitude error in the world frame
(3), gyro bias (3), velocity (3).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from edgemap.geometry.camera.attitude import GyroRotation
from edgemap.geometry.camera.imu import ImuSamples

Array = NDArray[np.float64]

GRAVITY_M_S2 = 9.81
OFFSET_RAD = math.radians(2.5)  # tilt that an uncalibrated accelerometer's offset shows (BMI055: 70 mg, 4 deg at most)
_TILT, _BIAS, _VELOCITY = slice(0, 3), slice(3, 6), slice(6, 9)


@dataclass(frozen=True, slots=True)
class InertialNoise:
    """Standard deviations of an inexpensive sensor on a small robot; densities are per square root of a second.

    gyro: of the integrated angle, rad. accel: of the integrated velocity, m/s, shaking included. bias_walk: rad/s.
    start_bias: rad/s, of a gyro that was never at rest. start_tilt: rad. speed, speed_s: velocity, m/s, and for how
    long it keeps its direction, s. rest_gyro, rest_accel: at rest samples scatter less, rad/s and m/s^2. rest_bias:
    of the mean rate over a second of rest, rad/s. rest_window_s: over which rest is judged. gap_s, gap: a longer hole
    between samples adds this rate, rad/s. lost_s: after such a hole the filter starts again.
    """

    gyro: float = 5e-4
    accel: float = 0.2
    bias_walk: float = 1e-5
    start_bias: float = 0.1
    start_tilt: float = math.radians(10.0)
    speed: float = 0.5
    speed_s: float = 0.5
    rest_gyro: float = 0.03
    rest_accel: float = 0.5
    rest_bias: float = 0.003
    rest_window_s: float = 0.5
    gap_s: float = 0.05
    gap: float = 0.5
    lost_s: float = 1.0


@dataclass(frozen=True, slots=True, eq=False)
class InertialState:
    """rotation (3, 3): optical directions into a z-up frame of unknown heading. bias (3,): of the gyro, rad/s.
    velocity (3,): m/s, z-up frame. covariance (9, 9). stamp_s: up to where samples are integrated. recent: samples of
    the last moments. rest_s: how long the camera has been at rest. still: at rest now."""

    rotation: Array
    bias: Array
    velocity: Array
    covariance: Array
    stamp_s: float
    recent: ImuSamples
    rest_s: float = 0.0

    @property
    def up_optical(self) -> Array:
        """The direction that points up, (3,), optical frame."""
        return self.rotation[2]

    def tilt_covariance(self) -> Array:
        """Of the angle about the camera's forward and right axes, levelled: roll and pitch, (2, 2) rad^2."""
        ahead = self.rotation[:2, 2] / max(float(np.linalg.norm(self.rotation[:2, 2])), 1e-9)
        axes = np.array([[ahead[0], ahead[1]], [ahead[1], -ahead[0]]])
        return axes @ self.covariance[:2, :2] @ axes.T


def inertial_start(samples: ImuSamples, stamp_s: float, noise: InertialNoise) -> InertialState:
    """The attitude that the mean specific force of the first samples (one or more) shows; the gyro's bias unknown."""
    up = samples.accel_m_s2.mean(axis=0)
    up = up / max(float(np.linalg.norm(up)), 1e-9)
    side = np.cross(up, [0.0, 0.0, 1.0] if abs(up[2]) < 0.9 else [1.0, 0.0, 0.0])
    side /= np.linalg.norm(side)
    mean_m_s2 = float(np.linalg.norm(samples.accel_m_s2.mean(axis=0)))
    tilt = noise.start_tilt + 2.0 * abs(mean_m_s2 / GRAVITY_M_S2 - 1.0)  # a camera that is pushed shows no gravity
    sigmas = [tilt] * 2 + [1e-6] + [noise.start_bias] * 3 + [noise.speed] * 3
    rotation = np.array([side, np.cross(up, side), up])
    return InertialState(rotation, np.zeros(3), np.zeros(3), np.diag(np.square(sigmas)), stamp_s, samples)


def inertial_step(
    state: InertialState, samples: ImuSamples, until_s: float, noise: InertialNoise
) -> tuple[InertialState, GyroRotation]:
    """Take in the samples (one or more) up to a stamp: the state there, and the rotation since the state's stamp."""
    span_s = until_s - state.stamp_s
    rotated, gained, gap_s = _integrated(state, samples, until_s, noise)
    before, force = state.rotation, state.rotation @ gained
    transition = np.eye(9)
    transition[_TILT, _BIAS] = -before * span_s
    transition[_VELOCITY, _TILT] = -_cross(force)
    transition[_VELOCITY, 2] = 0.0  # heading moves no velocity that a heading-free frame could know
    angle2 = noise.gyro**2 * span_s + (noise.gap * gap_s) ** 2
    diagonal = [angle2] * 3 + [noise.bias_walk**2 * span_s] * 3 + [noise.accel**2 * span_s + (5.0 * gap_s) ** 2] * 3
    covariance = transition @ state.covariance @ transition.T + np.diag(diagonal)
    recent = ImuSamples.joined([state.recent, samples]).between(until_s - noise.rest_window_s, until_s)
    predicted = InertialState(
        before @ rotated,
        state.bias,
        state.velocity + force - [0.0, 0.0, GRAVITY_M_S2 * span_s],
        covariance,
        until_s,
        recent,
        state.rest_s + span_s if _at_rest(state, recent, noise) else 0.0,
    )
    ahead, was_ahead = (
        predicted.rotation[:2, 2],
        before[:2, 2],
    )  # heading is where the optical axis points, seen from above
    yaw_rad = math.atan2(was_ahead[0] * ahead[1] - was_ahead[1] * ahead[0], float(was_ahead @ ahead))
    about = state.up_optical @ state.covariance[_BIAS, _BIAS] @ state.up_optical
    rotation = GyroRotation(rotated, yaw_rad, math.sqrt(angle2 + about * span_s**2))
    return _held(predicted, span_s, noise), rotation


def _held(state: InertialState, span_s: float, noise: InertialNoise) -> InertialState:
    """Velocities stay bounded; at rest there is none, and the mean rate is the bias."""
    selected = np.zeros((3, 9))
    selected[:, _VELOCITY] = np.eye(3)
    variance = noise.speed**2 * max(2.0 * noise.speed_s / span_s, 1.0)
    state = _corrected(state, selected, -state.velocity, variance, learns_vertical_bias=False)
    if state.rest_s < noise.rest_window_s:
        return state
    state = _corrected(state, selected, -state.velocity, 0.05**2, learns_vertical_bias=False)
    selected = np.zeros((3, 9))
    selected[:, _BIAS] = np.eye(3)
    rate = state.recent.gyro_rad_s.mean(axis=0)
    # The window's mean is nearly the same one frame later: each counts for its own share of a second.
    return _corrected(state, selected, rate - state.bias, noise.rest_bias**2 / span_s, learns_vertical_bias=True)


def _corrected(
    state: InertialState, selected: Array, residual: Array, variance: float, *, learns_vertical_bias: bool
) -> InertialState:
    """Kalman update in Joseph's form. Gravity says nothing of the bias about the vertical, so there its gain is zero:
    what a wrong velocity assumption would teach is worse than what was learnt at rest."""
    cross = state.covariance @ selected.T
    gain = np.linalg.solve(selected @ cross + variance * np.eye(3), cross.T).T
    if not learns_vertical_bias:
        up = state.up_optical
        gain[_BIAS] -= np.outer(up, up @ gain[_BIAS])
    change = gain @ residual
    left = np.eye(9) - gain @ selected
    return replace(
        state,
        rotation=rotation_of(change[_TILT][None])[0] @ state.rotation,
        bias=state.bias + change[_BIAS],
        velocity=state.velocity + change[_VELOCITY],
        covariance=left @ state.covariance @ left.T + variance * gain @ gain.T,
    )


def _integrated(
    state: InertialState, samples: ImuSamples, until_s: float, noise: InertialNoise
) -> tuple[Array, Array, float]:
    """Rotation (3, 3) and velocity (3,) gained in the optical frame of the state's stamp, and the time in holes.

    Trapezoids between samples; the last rate and force are held up to `until_s`.
    """
    stamps = np.concatenate([[state.stamp_s], samples.stamps_s, [until_s]])
    spans = np.maximum(np.diff(stamps), 0.0)
    first = state.recent if len(state.recent) else samples
    rates = np.concatenate([first.gyro_rad_s[-1:] if len(state.recent) else first.gyro_rad_s[:1], samples.gyro_rad_s])
    forces = np.concatenate([first.accel_m_s2[-1:] if len(state.recent) else first.accel_m_s2[:1], samples.accel_m_s2])
    rates = np.concatenate([(rates[:-1] + rates[1:]) / 2.0, rates[-1:]]) - state.bias
    forces = np.concatenate([(forces[:-1] + forces[1:]) / 2.0, forces[-1:]])
    total, gained = np.eye(3), np.zeros(3)
    for step, force, span in zip(rotation_of(rates * spans[:, None]), forces, spans, strict=True):
        after = total @ step
        gained += (total + after) @ force * (span / 2.0)
        total = after
    return total, gained, float(spans[spans > noise.gap_s].sum())


def _at_rest(state: InertialState, recent: ImuSamples, noise: InertialNoise) -> bool:
    """Whether the last moments show neither shaking nor a rate that the bias could not be."""
    if len(recent) < 5 or recent.stamps_s[-1] - recent.stamps_s[0] < 0.6 * noise.rest_window_s:
        return False
    unlike = np.abs(recent.gyro_rad_s.mean(axis=0) - state.bias)
    likely = 3.0 * np.sqrt(np.diag(state.covariance)[_BIAS]) + 0.003
    calm = recent.gyro_rad_s.std(axis=0).max() < noise.rest_gyro
    return bool(calm and recent.accel_m_s2.std(axis=0).max() < noise.rest_accel and (unlike < likely).all())


def rotation_of(vectors: Array) -> Array:
    """Rotation vectors (N, 3), rad, to matrices (N, 3, 3) (Rodrigues)."""
    angle = np.linalg.norm(vectors, axis=1)[:, None, None]
    skew = np.zeros((len(vectors), 3, 3))
    skew[:, 0, 1], skew[:, 0, 2], skew[:, 1, 2] = -vectors[:, 2], vectors[:, 1], -vectors[:, 0]
    skew -= skew.transpose(0, 2, 1)
    return np.eye(3) + np.sinc(angle / math.pi) * skew + 0.5 * np.sinc(angle / math.tau) ** 2 * (skew @ skew)


def _cross(vector: Array) -> Array:
    x, y, z = vector
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
