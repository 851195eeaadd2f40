"""Attitude from gyro and accelerometer: an error-state Kalman filter, one update a frame.

An accelerometer measures gravity only once the camera's acceleration averages out. It does, because velocity is
bounded: the filter integrates the velocity that its attitude implies and corrects it with odometry, or, without
odometry, loosely towards zero. A wrong tilt makes gravity leak into that velocity, which makes the error observable.
Odometry's yaw makes the gyro's bias about the vertical observable, which gravity does not; the mount, about which a
robot nods, makes the accelerometer's offset observable. States: attitude error in the world frame (3), gyro bias (3),
velocity (3), accelerometer offset (3).
"""

import math
from copy import copy
from dataclasses import dataclass

import numpy as np

from edgemap.geometry.arrays import Array
from edgemap.geometry.camera.attitude import GyroRotation, rotation_angle
from edgemap.geometry.camera.imu import ImuSamples
from edgemap.geometry.robust import CLEAR_SIGMAS
from edgemap.geometry.se2 import SE2, wrap_angle

GRAVITY_M_S2 = 9.81
OFFSET_RAD = math.radians(2.5)  # tilt that an uncalibrated accelerometer's offset shows (BMI055: 70 mg, 4 deg at most)
# Of a vector v (3,): (v @ SKEW).reshape(3, 3) @ w is v x w.
SKEW = np.array([[0, 0, 0, 0, 0, -1, 0, 1, 0], [0, 0, 1, 0, 0, 0, -1, 0, 0], [0, -1, 0, 1, 0, 0, 0, 0, 0]], dtype=float)


class _Rows:
    """Of the covariance."""

    TILT, BIAS, VELOCITY, OFFSET = (slice(first, first + 3) for first in (0, 3, 6, 9))
    ALL = 12


_IDENTITY, _DIAGONAL = np.eye(_Rows.ALL), np.diag_indices(_Rows.ALL)


@dataclass(frozen=True, slots=True)
class InertialNoise:
    """Standard deviations of an inexpensive sensor on a small robot; densities are per square root of a second."""

    gyro: float = 5e-4  # density of the integrated angle, rad
    gyro_share: float = 0.006  # of an angle, per root of a radian, by scale and misalignment (BMI055: 0.5 %, 0.3 deg)
    accel: float = 0.2  # density of the integrated velocity, m/s, shaking included
    offset: float = OFFSET_RAD  # of the accelerometer's offset, as a tilt, rad
    bias_walk: float = 1e-5  # density of the gyro's bias, rad/s
    start_bias: float = 0.0175  # rad/s, of a gyro that was never at rest
    speed: float = 0.5  # velocity, m/s, as one measurement per second
    # rad/s and m/s: at rest the samples scatter less (rad/s) and odometry measures less (both); also the standard
    # deviation of a velocity by odometry.
    resting: float = 0.05
    rest_window_s: float = 0.5  # over which rest is judged
    turned_share: float = 0.05  # of a yaw by odometry, beyond its covariance: its errors last longer than a step
    gap_s: float = 0.05  # longest time between samples; rotation in a longer hole is not measured
    hole: float = 1.0  # density of the change of the rate in such a hole, rad/s


class InertialFilter:
    """The estimate up to the last samples.

    rotation (3, 3): optical directions into a z-up frame of unknown heading. bias (3,): of the gyro, rad/s.
    velocity (3,): m/s, z-up frame. offset (3,): of the accelerometer, m/s^2, optical axes. covariance (12, 12).
    stamp_s: up to where samples are integrated. recent: samples of the last moments. rest_s: how long the camera has
    been at rest. before: the estimate of the step before, itself without one. calm: whether odometry measured so little
    motion that the camera may be at rest, None without odometry."""

    def __init__(
        self, samples: ImuSamples, stamp_s: float, noise: InertialNoise, sigma_rad: float, mount_up: Array | None = None
    ) -> None:
        """The attitude from the mean specific force of the first samples (one or more); the gyro's bias is unknown.

        sigma_rad: standard deviation of the tilt. mount_up: (3,), the mount's up direction, which is taken instead of
        the force's; it makes the accelerometer's offset observable.
        """
        force = samples.accel_m_s2.mean(axis=0)
        mean_m_s2 = float(np.linalg.norm(force))
        if mount_up is None:
            # A walk mistaken for rest at the start would appear as an acceleration, so the velocity is known less.
            up, speed = force / max(mean_m_s2, 1e-9), CLEAR_SIGMAS * noise.speed
            sigma_rad += 0.5 * abs(mean_m_s2 / GRAVITY_M_S2 - 1.0)  # a camera that is pushed shows no gravity
        else:
            up, speed = mount_up, noise.speed
        side = np.cross(up, [0.0, 0.0, 1.0] if abs(up[2]) < 0.9 else [1.0, 0.0, 0.0])
        side /= np.linalg.norm(side)
        offset = noise.offset * GRAVITY_M_S2
        sigmas = [sigma_rad] * 2 + [1e-6] + [noise.start_bias] * 3 + [speed] * 3 + [offset] * 3
        self._noise, self.stamp_s, self.recent, self.rest_s = noise, stamp_s, samples, 0.0
        self.before: InertialFilter | None = None
        self.calm: bool | None = None
        self.rotation, self.covariance = np.array([side, np.cross(up, side), up]), np.diag(np.square(sigmas))
        self.bias, self.velocity, self.offset = np.zeros((3, 3))
        if mount_up is None:  # the offset that the mean force holds is a tilt
            mixed = _IDENTITY.copy()
            mixed[:2, _Rows.OFFSET] = np.array([-self.rotation[1], self.rotation[0]]) / GRAVITY_M_S2
            self.covariance = mixed @ self.covariance @ mixed.T
        else:
            share = offset**2 / (offset**2 + noise.accel**2)  # against what a second of the robot's acceleration leaves
            self.covariance[_Rows.OFFSET, _Rows.OFFSET] *= 1.0 - share
            self.offset = share * (force - GRAVITY_M_S2 * up)

    @property
    def up_optical(self) -> Array:
        """The direction that points up, (3,), optical frame."""
        return self.rotation[2]

    @property
    def force_optical(self) -> Array:
        """The specific force that the accelerometer measures at rest, offset included, (3,), optical frame, in units of
        g.
        """
        return self.rotation[2] + self.offset / GRAVITY_M_S2

    @property
    def heading(self) -> Array:
        """Horizontal direction of the optical axis: a unit vector (2,), z-up frame."""
        return self.rotation[:2, 2] / max(math.hypot(*self.rotation[:2, 2].tolist()), 1e-9)

    def tilt_covariance(self) -> Array:
        """Covariance of the angles about the camera's level forward and right axes: roll and pitch, (2, 2) rad^2."""
        ahead = self.heading
        axes = np.array([[ahead[0], ahead[1]], [ahead[1], -ahead[0]]])
        return axes @ self.covariance[:2, :2] @ axes.T

    def moved(self, motion: SE2, covariance: Array, arm_optical_m: Array) -> None:
        """Update with an odometry that does not use the gyro: motion of the base over the last step with covariance
        (3, 3).

        arm_optical_m: from the floor below the lens up to it, and from the base's origin to there, (2, 3), optical
        axes. A camera high above the base swings as the robot nods; pictures measure that, wheels do not.
        """
        before, noise = self.before, self._noise
        if before is None:
            return
        span_s = self.stamp_s - before.stamp_s
        x, y = before.heading.tolist()
        axes = np.array([[x, -y], [y, x], [0.0, 0.0]]) / span_s  # forward and left of the base, in the world
        swung, displaced = ((self.rotation - before.rotation) @ arm_optical_m.T).T
        loose = noise.resting**2 + float(swung @ swung) / span_s**2
        variance = axes @ covariance[:2, :2] @ axes.T
        variance += np.diag([loose, loose, noise.resting**2])
        residual = displaced / span_s + axes @ [motion.x_m, motion.y_m] - (self.velocity + before.velocity) / 2.0
        turned_rad = _turned_rad(before.rotation, self.rotation)
        self._correct(_IDENTITY[_Rows.VELOCITY], residual, variance, robust=True)
        variance = float(covariance[2, 2]) + noise.gyro**2 * span_s + (noise.turned_share * motion.yaw_rad) ** 2
        about = np.zeros((1, _Rows.ALL))
        about[0, _Rows.BIAS] = self.up_optical
        off = np.array([wrap_angle(turned_rad - motion.yaw_rad) / span_s])
        self._correct(about, off, np.array([[variance / span_s**2]]), vertical=True, robust=True)
        slow = math.hypot(motion.x_m, motion.y_m) < noise.resting * span_s
        self.calm = slow and abs(motion.yaw_rad) < noise.resting * span_s

    def displaced(self, arm_optical_m: Array) -> tuple[Array, Array]:
        """Displacement (2,), m, of the base over the last step, forward and left of where it was, and its covariance
        (2, 2): the velocity that odometry measured before, and what the accelerometer added. arm_optical_m: as of
        `moved`.
        """
        before = self.before or self
        span_s = self.stamp_s - before.stamp_s
        x, y = before.heading.tolist()
        axes = np.array([[x, y, 0.0], [-y, x, 0.0]])
        arm = (self.rotation - before.rotation) @ arm_optical_m[1]
        covariance = (before.covariance + self.covariance)[_Rows.VELOCITY, _Rows.VELOCITY] / 2.0
        return axes @ ((self.velocity + before.velocity) / 2.0 * span_s - arm), axes @ covariance @ axes.T * span_s**2

    def mounted(self, up_optical: Array, sigmas_rad: Array) -> None:
        """Update with the constraint that the camera nods about its mount.

        up_optical: (3,) on the level robot. sigmas_rad: (2,) of the nods, about the world's axes.
        """
        off = self.rotation @ up_optical
        self._correct(_IDENTITY[_Rows.TILT][:2], np.array([off[1], -off[0]]), np.diag(np.square(sigmas_rad)))

    def remounted(self, before: Array, after: Array) -> None:
        """Replaces the up direction (3,) that earlier mount updates used by another one (optical frame): the measured
        force stays, so the tilt and the accelerometer's offset change by the same angle.
        """
        rotation = self.rotation @ small_rotation(*np.cross(after, before).tolist())
        self.offset = self.offset + GRAVITY_M_S2 * (self.rotation[2] - rotation[2])
        self.rotation = rotation

    def step(self, samples: ImuSamples, until_s: float) -> GyroRotation:
        """Integrates the samples (one or more) up to a stamp. Returns the rotation since the last one."""
        before, noise, span_s = copy(self), self._noise, until_s - self.stamp_s
        before.before = None
        rotated, gained, holes_s, unseen_s3 = self._integrated(samples, until_s)
        force = before.rotation @ gained
        x, y, z = force.tolist()
        transition = _IDENTITY.copy()
        transition[_Rows.TILT, _Rows.BIAS] = transition[_Rows.VELOCITY, _Rows.OFFSET] = -span_s * before.rotation
        # The heading moves no velocity that a heading-free frame could know.
        transition[_Rows.VELOCITY, _Rows.TILT] = [[0.0, z, 0.0], [-z, 0.0, 0.0], [y, -x, 0.0]]
        angle2 = noise.gyro**2 * span_s + noise.gyro_share**2 * rotation_angle(rotated)
        angle2 += noise.hole**2 * unseen_s3
        gained2 = noise.accel**2 * span_s + (GRAVITY_M_S2 / 2.0 * float(holes_s.sum())) ** 2
        self.covariance = transition @ before.covariance @ transition.T
        self.covariance[_DIAGONAL] += [angle2] * 3 + [noise.bias_walk**2 * span_s] * 3 + [gained2] * 3 + [0.0] * 3
        self.rotation = before.rotation @ rotated
        self.velocity = before.velocity + force - [0.0, 0.0, GRAVITY_M_S2 * span_s]
        self.recent = ImuSamples.joined([before.recent, samples]).between(until_s - noise.rest_window_s, until_s)
        self.rest_s = before.rest_s + span_s if before.calm is not False and before._at_rest(self.recent) else 0.0
        self.before, self.stamp_s = before, until_s
        about = before.up_optical @ before.covariance[_Rows.BIAS, _Rows.BIAS] @ before.up_optical
        axis = before.rotation @ (SKEW @ rotated.ravel())
        nodded2 = float(axis[:2] @ axis[:2]) / 4.0
        tilt2 = float(before.covariance[0, 0] + before.covariance[1, 1]) / 2.0
        sigma_rad = math.sqrt(angle2 + about * span_s**2 + nodded2 * tilt2)  # of a nod, a wrong tilt makes yaw
        turn = GyroRotation(rotated, _turned_rad(before.rotation, self.rotation), sigma_rad)
        self._hold(span_s)
        return turn

    def _hold(self, span_s: float) -> None:
        """Bounds velocities that no odometry measures. At rest the velocity is zero and the mean rate is the bias;
        about the vertical only without odometry, which distinguishes a slow turn from rest."""
        noise, selected = self._noise, _IDENTITY[_Rows.VELOCITY]
        if self.calm is None:
            self._correct(selected, -self.velocity, noise.speed**2 * max(1.0 / span_s, 1.0) * np.eye(3))
        if self.rest_s < noise.rest_window_s:
            return
        self._correct(selected, -self.velocity, noise.resting**2 * np.eye(3))
        rate = self.recent.gyro_rad_s.mean(axis=0)
        # The window's mean is nearly the same one frame later: each counts for its share of a second.
        variance = noise.resting**2 / len(self.recent) / span_s * np.eye(3)
        self._correct(_IDENTITY[_Rows.BIAS], rate - self.bias, variance, vertical=self.calm is None)

    def _correct(
        self, selected: Array, residual: Array, variance: Array, *, vertical: bool = False, robust: bool = False
    ) -> None:
        """Kalman update in Joseph's form. vertical: whether it measures the gyro's bias about the vertical. Gravity
        does not, so its gain there is zero: a wrong assumption of the velocity would make it worse than the estimate at
        rest. robust: the variance of a measurement with a larger residual than it states is inflated."""
        cross = self.covariance @ selected.T
        expected = selected @ cross + variance
        information = np.linalg.inv(expected)
        gain = cross @ information
        if robust and (excess := float(residual @ information @ residual) / len(residual)) > 1.0:
            variance, gain = variance + (excess - 1.0) * expected, gain / excess
        if not vertical:
            up = self.up_optical
            gain[_Rows.BIAS] -= up[:, None] * (up @ gain[_Rows.BIAS])
        change = gain @ residual
        left = _IDENTITY - gain @ selected
        self.rotation = small_rotation(*change[_Rows.TILT].tolist()) @ self.rotation
        self.bias = self.bias + change[_Rows.BIAS]
        self.velocity = self.velocity + change[_Rows.VELOCITY]
        self.offset = self.offset + change[_Rows.OFFSET]
        self.covariance = left @ self.covariance @ left.T + gain @ variance @ gain.T

    def _integrated(self, samples: ImuSamples, until_s: float) -> tuple[Array, Array, Array, float]:
        """Rotation (3, 3) and velocity (3,) gained in the optical frame of the estimate's stamp; the lengths of holes
        (H,), s; the variance of the angle in them for rates that walk by 1 rad/s in a root of a second, s^3.

        Trapezoids between samples; the last rate and force are held up to `until_s`.
        """
        stamps = np.concatenate([[self.stamp_s], samples.stamps_s, [until_s]])
        spans = np.maximum(stamps[1:] - stamps[:-1], 0.0)
        before, last = (self.recent, -1) if len(self.recent) else (samples, 0)
        rates = np.concatenate([before.gyro_rad_s[last, None], samples.gyro_rad_s, samples.gyro_rad_s[-1:]])
        forces = np.concatenate([before.accel_m_s2[last, None], samples.accel_m_s2, samples.accel_m_s2[-1:]])
        rates = (rates[:-1] + rates[1:]) / 2.0 - self.bias
        gains = ((forces[:-1] + forces[1:]) / 2.0 - self.offset) * spans[:, None]
        rotations, reach = rotation_of(rates * spans[:, None]), 1
        while reach < len(rotations):  # each becomes the product of all up to it
            rotations[reach:] = rotations[:-reach] @ rotations[reach:]
            reach *= 2
        adjacent = gains.copy()  # of the spans before and after each rotation
        adjacent[:-1] += gains[1:]
        gained = (gains[0] + np.einsum("nij,nj->i", rotations, adjacent)) / 2.0
        held_s = max(self.stamp_s - float(before.stamps_s[last]), 0.0) if len(self.recent) else 0.0
        holes = spans > self._noise.gap_s
        holes[0] |= held_s + spans[0] > self._noise.gap_s
        unseen_s3 = spans**3 / 12.0  # a Brownian bridge between the rates at both ends
        unseen_s3[0] += held_s * spans[0] ** 2 / 4.0  # the rate before the estimate's stamp stands for the one there
        unseen_s3[-1] = spans[-1] ** 3 / 3.0  # no rate is measured at this end
        return rotations[-1], gained, spans[holes], float(unseen_s3[holes].sum())

    def _at_rest(self, recent: ImuSamples) -> bool:
        """Whether the last moments show neither shaking nor a rate that the bias could not be."""
        if len(recent) < 5 or recent.stamps_s[-1] - recent.stamps_s[0] < 0.6 * self._noise.rest_window_s:
            return False
        unlike = np.abs(recent.gyro_rad_s.mean(axis=0) - self.bias)
        # An IMU may be poorer than a BMI055: EuRoC's gyro has 4.5 deg/s of bias before it rests.
        likely = 5.0 * np.sqrt(np.diag(self.covariance)[_Rows.BIAS]) + 0.003
        return bool(recent.gyro_rad_s.std(axis=0).max() < self._noise.resting and (unlike < likely).all())


def _turned_rad(before: Array, after: Array) -> float:
    """Change of the optical axis's heading between two rotations (3, 3) into the z-up frame, counter-clockwise."""
    (x, y), (u, v) = before[:2, 2].tolist(), after[:2, 2].tolist()
    return math.atan2(x * v - y * u, x * u + y * v)


def small_rotation(x: float, y: float, z: float) -> Array:
    """`rotation_of` one vector, in a fifth of its time."""
    angle = math.sqrt(x * x + y * y + z * z)
    s, r = (math.sin(angle) / angle, (1.0 - math.cos(angle)) / angle**2) if angle > 1e-6 else (1.0, 0.5)
    return np.array(
        [
            [1.0 - r * (y * y + z * z), r * x * y - s * z, r * x * z + s * y],
            [r * x * y + s * z, 1.0 - r * (x * x + z * z), r * y * z - s * x],
            [r * x * z - s * y, r * y * z + s * x, 1.0 - r * (x * x + y * y)],
        ]
    )


def rotation_of(vectors: Array) -> Array:
    """Rotation vectors (N, 3), rad, to matrices (N, 3, 3) (Rodrigues)."""
    angle = np.sqrt(np.maximum((vectors * vectors).sum(axis=1), 1e-24))[:, None, None]
    half = np.sin(angle / 2.0) / angle
    skew = (vectors @ SKEW).reshape(-1, 3, 3)
    outer = vectors[:, :, None] * vectors[:, None, :]
    return np.cos(angle) * np.eye(3) + np.sin(angle) / angle * skew + 2.0 * half * half * outer
