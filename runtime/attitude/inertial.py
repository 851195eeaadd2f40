"""Attitude of each frame from the camera's IMU, where its samples come with the frames."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np

from edgemap.geometry.camera.attitude import Attitude, GyroRotation
from edgemap.geometry.camera.inertial import (
    GRAVITY_M_S2,
    OFFSET_RAD,
    InertialNoise,
    InertialState,
    inertial_start,
    inertial_step,
    rotation_of,
)
from edgemap.geometry.camera.mount import Mount
from edgemap.runtime.attitude.checked_mount import MountRule
from edgemap.runtime.attitude.protocol import AttitudeSource
from edgemap.runtime.attitude.sources import NODDING_RAD
from edgemap.runtime.calibration.level import up_optical
from edgemap.runtime.frame import Frame

SURE_RAD = math.radians(1.0)  # an IMU that says so of itself is believed: it is two to three times as good
LIKELY = 1.5  # standard deviations, that a robot is taken to nod by where the IMU says that it does
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

    def nodding_rad2(self) -> np.ndarray:
        """Variance (2,) of the deviations about their mean, the rule's at least."""
        scatter = (self._squares - self._sum**2 / max(self._count, 1)) / max(self._count, 1)
        return np.maximum(scatter, self._rule.nodding_rad**2)

    def estimate(self) -> tuple[np.ndarray, np.ndarray]:
        """The constant (2,), rad, and its variance (2,)."""
        prior = self._rule.offset_rad**2
        if not self._count:
            return np.zeros(2), np.full(2, prior)
        mean = self._sum / self._count
        variance = self.nodding_rad2() / max(self._seconds / (2.0 * self._rule.nodding_s), 1.0)
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

    What is constant between IMU and mount is taken for the accelerometer's offset, which turns with the camera, and
    taken out of its samples: beside the filter it would stay where it was in the room as the camera turns.

    Starts with the first samples, and again after a hole of `InertialNoise.lost_s`.
    """

    name = "imu"

    def __init__(self, mount: Mount, other: AttitudeSource, rule: AttitudeRule | None = None) -> None:
        rule = rule or AttitudeRule()
        self._mount = np.array([mount.roll_rad, mount.pitch_rad])
        self._other, self._noise = other, rule.noise
        self._tilt, self._check = ConstantTilt(rule), MountCheck(mount, rule)
        self._offset = np.zeros(2)  # roll and pitch that the accelerometer's own offset shows, taken out of its samples
        self._state: InertialState | None = None

    def step(self, frame: Frame) -> Attitude:
        """The attitude at the frame's stamp."""
        other = self._other.step(frame)
        state, rotation = self._state, None
        if not len(frame.imu):
            if state is not None and frame.stamp_s - state.stamp_s > self._noise.lost_s:
                self._state = None
            return other
        samples = replace(frame.imu, accel_m_s2=frame.imu.accel_m_s2 - GRAVITY_M_S2 * self._up_error())
        frame = replace(frame, imu=samples)
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
        measured = np.array([plain.roll_rad, plain.pitch_rad]) + self._offset
        self._tilt.learn(measured - self._mount, span_s)
        fault = self._check.judge(measured, span_s)
        before = self._up_error()
        self._offset, variance = self._tilt.estimate()
        up = state.up_optical + before - self._up_error()
        turn = rotation_of(-np.cross(state.up_optical, up)[None])[0]
        self._state = state = replace(state, rotation=state.rotation @ turn)
        covariance = plain.covariance_rad2 + np.diag(variance)
        found = Attitude.of_up(state.up_optical, covariance, self.name)
        return replace(self._held(found), rotation=rotation, fault=fault)

    def _held(self, found: Attitude) -> Attitude:
        """An attitude between the IMU's and the mount's: what is mounted nods little, so an IMU that has not learnt its
        bias yet says less than the mount. The farther off the mount, the less that says."""
        off = np.array([found.roll_rad, found.pitch_rad]) - self._mount
        own = np.diag(found.covariance_rad2)
        mounted = np.maximum(self._tilt.nodding_rad2(), (off / LIKELY) ** 2)
        gain = mounted / (mounted + np.maximum(own - SURE_RAD**2, 0.0))
        roll, pitch = (float(value) for value in self._mount + gain * off)
        covariance = found.covariance_rad2 * np.sqrt(np.outer(gain, gain))
        return replace(found, roll_rad=roll, pitch_rad=pitch, covariance_rad2=covariance)

    def _up_error(self) -> np.ndarray:
        """By how much an offset accelerometer's up is off, (3,), optical frame, in parts of gravity."""
        roll, pitch = self._mount
        return up_optical(pitch + self._offset[1], roll + self._offset[0]) - up_optical(pitch, roll)
