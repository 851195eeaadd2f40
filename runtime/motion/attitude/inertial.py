"""Attitude of each frame from the camera's IMU, where its samples come with the frames."""

import math
from dataclasses import dataclass, field, replace

import numpy as np

from edgemap.geometry.camera.attitude import Attitude, GyroRotation
from edgemap.geometry.camera.carried import CarriedRule
from edgemap.geometry.camera.imu import ImuSamples
from edgemap.geometry.camera.inertial import InertialFilter, InertialNoise
from edgemap.geometry.camera.mount import Mount, pitch_roll, up_optical
from edgemap.runtime.frames.frame import Frame
from edgemap.runtime.motion.attitude.imu_trust import ImuTrust
from edgemap.runtime.motion.attitude.mount_check import MountRule
from edgemap.runtime.motion.attitude.pictures import LONGEST_S
from edgemap.runtime.motion.attitude.source import Moved

NOD_S = 1.0 / math.tau  # swing of a nod against its rate, at 1 Hz
LIKELY = 2.0  # standard deviations of nodding, at which the mount has half the weight for the tilt
START_S = 0.1  # of samples, whose mean force is the first guess of where up is


@dataclass(frozen=True, slots=True)
class AttitudeRule:
    """Weights of gravity and mount, which differ by a constant tilt: the accelerometer's offset (BMI055: 70 mg, 4 deg)
    and the mount's error.
    """

    noise: InertialNoise = field(default_factory=InertialNoise)  # of the sensor and the filter
    # Of the mount; its `tilt.nod` is how far a robot nods about the mount, as one measurement per second.
    check: MountRule = field(default_factory=MountRule)


class InertialAttitude:
    """Roll, pitch and rotation by gyro, accelerometer and the odometry's last motion, about the mount. Starts with the
    first samples, and again after a hole of `LONGEST_S`. fault: of the last frame.
    """

    name = "imu"

    def __init__(self, mount: Mount, rule: AttitudeRule, carried: CarriedRule, trust: ImuTrust) -> None:
        self._rule, self._carried, self._trust = rule, carried, trust
        self._up = up_optical(mount.pitch_rad, mount.roll_rad)
        arms = [(0.0, 0.0, mount.height_m), (mount.forward_m, mount.left_m, 0.0)]
        self._arm = np.array(arms) @ mount.rotation_base_optical()
        self._noise, self.fault = rule.noise, None
        self._filter: InertialFilter | None = None
        self._seen_s = -math.inf
        self._rate2, self._judged_s = 0.0, 0.0  # mean square of the tilt's rate, and over how long

    def predict(self, frame: Frame, moved: Moved | None, other: Attitude) -> Attitude:
        """The attitude at the frame's stamp; without samples another source's. moved: as of `AttitudeSource`."""
        state, stamp_s = self._filter, frame.stamp_s
        bias = np.zeros(3) if state is None else state.bias
        samples, self.fault = self._trust.judge(frame.imu, stamp_s, moved, self._up, bias)
        before_s, self._seen_s = self._seen_s, stamp_s
        if self._trust.left_out or (state is not None and stamp_s - state.stamp_s > LONGEST_S):
            state = self._filter = None
        if self._trust.left_out or not len(samples):
            if state is not None:  # the odometry's next motion is of other times
                state.before = None
            return other
        if state is None or stamp_s <= state.stamp_s:
            state, rotation = self._begun(samples, stamp_s, before_s)
        else:
            rotation = self._continued(state, samples, stamp_s, before_s, moved)
        self._filter = state
        if rotation is not None:
            swings = not self._calm() and self._trust.follows_gravity
            rotation = replace(rotation, proved=swings or self._trust.proved)
        attitude = Attitude.of_up(state.up_optical, state.tilt_covariance(), self.name)
        return replace(attitude, rotation=rotation, force_rad=np.array(pitch_roll(state.force_optical)[::-1]))

    def correct_mount(self, mount: Mount) -> None:
        """Corrects the mount's angles, and with them the tilt and the accelerometer's offset that it determined."""
        before, self._up = self._up, up_optical(mount.pitch_rad, mount.roll_rad)
        if self._filter is not None:
            self._filter.remounted(before, self._up)

    def _begun(
        self, samples: ImuSamples, stamp_s: float, before_s: float
    ) -> tuple[InertialFilter, GyroRotation | None]:
        """Starts with the earliest samples and integrates to the frame; samples at rest before it determine the bias.
        Also returns the rotation since the previous frame, where the samples reach back to it."""
        noise = self._noise
        first_s = float(samples.stamps_s[0])
        reaches = before_s <= first_s < before_s + noise.gap_s
        edges = [*np.arange(first_s + START_S, stamp_s - 1e-6, START_S).tolist(), stamp_s]
        first = samples.between(-math.inf, edges[0])
        edges = [before_s, stamp_s] if reaches else edges
        start_rad = self._rule.check.tilt.prior  # the first samples err by no more than a mount
        state, rotation = InertialFilter(first, edges[0], noise, start_rad), None
        self._rate2, self._judged_s = 0.0, 0.0
        self._nodded(state, first, START_S)
        if self._calm() and float(state.up_optical @ self._up) > math.cos(start_rad):
            state = InertialFilter(first, edges[0], noise, float(self._nods(np.zeros(2))[0]), self._up)
        for edge_s in edges[1:]:
            part = samples.between(state.stamp_s, edge_s)
            rotation = state.step(part, edge_s) if len(part) else rotation
        return state, rotation if reaches else None

    def _continued(
        self, state: InertialFilter, samples: ImuSamples, stamp_s: float, before_s: float, moved: Moved | None
    ) -> GyroRotation | None:
        """Advances the filter to a frame. Returns the rotation since the previous one, where that one had samples. The
        tilt is pulled towards the mount, less with distance, so a carried camera stays free."""
        from_s, span_s, state.calm = state.stamp_s, stamp_s - state.stamp_s, None
        if moved is not None:
            state.moved(*moved, self._arm)
        self._nodded(state, samples, span_s)
        rotation = state.step(samples, stamp_s)
        rotation = replace(rotation, displaced=state.displaced(self._arm))
        nods = self._nods((state.rotation @ self._up)[1::-1])
        state.mounted(self._up, nods * math.sqrt(max(1.0 / span_s, 1.0)))
        if from_s != before_s:  # the odometry's motions are of other times
            state.before = None
            return None
        return rotation

    def _calm(self) -> bool:
        """Whether the camera swings no faster than one on a robot."""
        return math.sqrt(self._rate2) < self._carried.rate_rad_s[0]

    def _nods(self, off_rad: np.ndarray) -> np.ndarray:
        """Standard deviation of the tilt about the mount (2,), by its offset from it and its rate."""
        nodding = self._rule.check.tilt.nod
        return nodding * (1.0 + (off_rad**2 + self._rate2 * NOD_S**2) / (LIKELY * nodding) ** 2)

    def _nodded(self, state: InertialFilter, samples: ImuSamples, span_s: float) -> None:
        """Updates the rate of the tilt: a head nods faster than a robot."""
        rate = samples.gyro_rad_s.mean(axis=0) - state.bias
        rate -= (rate @ state.up_optical) * state.up_optical
        self._judged_s += span_s
        self._rate2 += min(span_s / min(self._judged_s, self._carried.rate_s), 1.0) * (float(rate @ rate) - self._rate2)
