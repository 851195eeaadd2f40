"""Attitude of each frame from the camera's IMU, where its samples come with the frames."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from edgemap.geometry.camera.attitude import Attitude, GyroRotation
from edgemap.geometry.camera.inertial import OFFSET_RAD, InertialNoise, InertialState, inertial_start, inertial_step
from edgemap.geometry.camera.mount import Mount
from edgemap.runtime.attitude.checked_mount import MountRule
from edgemap.runtime.attitude.protocol import AttitudeSource
from edgemap.runtime.attitude.sources import NODDING_RAD
from edgemap.runtime.frame import Frame

START_S = 0.1  # of samples, whose mean force is the first guess of where up is


@dataclass(frozen=True, slots=True)
class AttitudeRule:
    """How gravity is weighed against the mount; between both lies a constant tilt: the accelerometer's offset (BMI055:
    70 mg, 4 deg) and the mount's error.

    offset_rad: of that constant. farthest_rad: what is tilted more is no offset, but a camera that is held otherwise.
    nodding_rad, nodding_s: of a level robot about its mount, and for how long it stays so. judged_s: of samples, before
    the mount is called wrong. steady_rad: standard deviation of tilt below which a camera is mounted, not carried.
    wrong_rad: more than the accelerometer's offset. noise: of the sensor and the filter. check:
    of the mount, by the pictures.
    mount_sigma_rad: of the mount's angles where nothing measures tilt: a robot on wheels that brakes on hard floors.
    """

    offset_rad: float = OFFSET_RAD
    farthest_rad: float = math.radians(6.0)
    nodding_rad: float = math.radians(0.5)
    nodding_s: float = 2.0
    judged_s: float = 10.0
    steady_rad: float = math.radians(2.0)
    wrong_rad: float = math.radians(4.5)
    mount_sigma_rad: float = NODDING_RAD
    noise: InertialNoise = field(default_factory=InertialNoise)
    check: MountRule = field(default_factory=MountRule)


class ConstantTilt:
    """The mean of what the IMU says beyond the mount, roll and pitch, taken for a constant as far as its scatter lets.

    Raises nothing; deviations above `farthest_rad` teach nothing.
    """

    def __init__(self, rule: AttitudeRule) -> None:
        self._rule = rule
        self._sum, self._squares, self._seconds, self._count = np.zeros(2), np.zeros(2), 0.0, 0

    def learn(self, deviation_rad: np.ndarray, span_s: float) -> None:
        """One frame's deviation (2,) from the mount, which stands for this time."""
        if np.abs(deviation_rad).max() < self._rule.farthest_rad:
            self._sum, self._squares = self._sum + deviation_rad, self._squares + deviation_rad**2
            self._seconds, self._count = self._seconds + span_s, self._count + 1

    def estimate(self) -> tuple[np.ndarray, np.ndarray]:
        """The constant (2,), rad, and its variance (2,)."""
        prior = self._rule.offset_rad**2
        if not self._count:
            return np.zeros(2), np.full(2, prior)
        mean = self._sum / self._count
        scatter = np.maximum(self._squares / self._count - mean**2, self._rule.nodding_rad**2)
        variance = scatter / max(self._seconds / (2.0 * self._rule.nodding_s), 1.0)
        gain = prior / (prior + variance)
        return gain * mean, prior * (1.0 - gain)


class MountCheck:
    """Tells once where gravity and the mount differ by more than an accelerometer's offset can explain.

    A camera that is carried and not mounted, whose tilt scatters, is not judged.
    """

    def __init__(self, mount: Mount, rule: AttitudeRule) -> None:
        self._rule = rule
        self._mount, self._sum, self._squares = mount, np.zeros(2), np.zeros(2)
        self._seconds, self._count, self._told = 0.0, 0, False

    def judge(self, measured_rad: np.ndarray, span_s: float) -> str:
        """The fault, from one more frame's roll and pitch (2,) by gravity; empty where there is none or it was told."""
        self._sum, self._squares = self._sum + measured_rad, self._squares + measured_rad**2
        self._seconds, self._count = self._seconds + span_s, self._count + 1
        if self._told or self._seconds < self._rule.judged_s:
            return ""
        mean = self._sum / self._count
        scatter = np.sqrt(np.maximum(self._squares / self._count - mean**2, 0.0))
        off = np.abs(mean - [self._mount.roll_rad, self._mount.pitch_rad])
        if scatter.max() > self._rule.steady_rad or off.max() < self._rule.wrong_rad:
            return ""
        self._told = True
        given = f"pitch {math.degrees(self._mount.pitch_rad):.1f} and roll {math.degrees(self._mount.roll_rad):.1f} deg"
        likelier = f"pitch {math.degrees(mean[1]):.1f} and roll {math.degrees(mean[0]):.1f} deg"
        return f"mount: {given} given, gravity over {self._seconds:.0f} s says {likelier}: measure it again"


class InertialAttitude:
    """Roll, pitch and rotation by gyro and accelerometer, against the mount; without samples the `other` source.

    Starts with the first samples, and again after a hole of `InertialNoise.lost_s`.
    """

    name = "imu"

    def __init__(self, mount: Mount, other: AttitudeSource, rule: AttitudeRule | None = None) -> None:
        rule = rule or AttitudeRule()
        self._mount = np.array([mount.roll_rad, mount.pitch_rad])
        self._other, self._noise = other, rule.noise
        self._tilt, self._check = ConstantTilt(rule), MountCheck(mount, rule)
        self._state: InertialState | None = None

    def step(self, frame: Frame) -> Attitude:
        """The attitude at the frame's stamp."""
        other = self._other.step(frame)
        state, rotation = self._state, None
        if not len(frame.imu):
            if state is not None and frame.stamp_s - state.stamp_s > self._noise.lost_s:
                self._state = None
            return other
        if state is None or not 0.0 < frame.stamp_s - state.stamp_s <= self._noise.lost_s:
            self._state = self._begun(frame)
        else:
            self._state, rotation = inertial_step(state, frame.imu, frame.stamp_s, self._noise)
        return self._against_mount(self._state, rotation, 0.0 if state is None else frame.stamp_s - state.stamp_s)

    def reset(self, reason: str) -> None:
        """Start again with the next samples; the constant tilt is kept."""
        self._state = None
        self._other.reset(reason)

    def _begun(self, frame: Frame) -> InertialState:
        """Started with the earliest samples and taken on to the frame: a camera at rest before it teaches the bias."""
        samples, noise = frame.imu, self._noise
        edges = [*np.arange(samples.stamps_s[0] + START_S, frame.stamp_s - 1e-6, START_S).tolist(), frame.stamp_s]
        state = inertial_start(samples.between(-math.inf, edges[0]), edges[0], noise)
        for edge_s in edges[1:]:
            part = samples.between(state.stamp_s, edge_s)
            if len(part):
                state, _ = inertial_step(state, part, edge_s, noise)
        return state

    @property
    def constant_tilt(self) -> tuple[np.ndarray, np.ndarray]:
        """Of the IMU against the mount, roll and pitch (2,), rad, with variances (2,)."""
        return self._tilt.estimate()

    def _against_mount(self, state: InertialState, rotation: GyroRotation | None, span_s: float) -> Attitude:
        plain = Attitude.of_up(state.up_optical, state.tilt_covariance(), self.name)
        measured = np.array([plain.roll_rad, plain.pitch_rad])
        self._tilt.learn(measured - self._mount, span_s)
        offset, variance = self._tilt.estimate()
        roll, pitch = (float(value) for value in measured - offset)
        covariance = plain.covariance_rad2 + np.diag(variance)
        fault = self._check.judge(measured, span_s)
        return Attitude(roll, pitch, covariance, rotation=rotation, source=self.name, fault=fault)
