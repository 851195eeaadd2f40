"""Checks the mount's height without wheels or depth: by what stands on the floor, and by the accelerometer."""

from __future__ import annotations

import math
from collections import defaultdict, deque
from dataclasses import dataclass

import numpy as np

from edgemap.geometry.camera.acceleration_scale import MovedStep, accelerations, scale_of
from edgemap.geometry.camera.floor import FloorCamera, FloorNoise
from edgemap.geometry.camera.mount import Mount
from edgemap.geometry.observations.class_extents import HEIGHT_M
from edgemap.geometry.observations.detections import Detections
from edgemap.geometry.observations.lens_height import lens_heights
from edgemap.geometry.robust import median_and_scatter
from edgemap.runtime.frame import Frame
from edgemap.runtime.odometry.protocol import Motion


@dataclass(frozen=True, slots=True)
class HeightRule:
    """When a mount's height counts as wrong.

    every_s: between two pictures whose boxes count, as neighbours repeat each other. fewest, kept: boxes of a class.
    loose: scatter of a class's boxes, as a share, above which they do not count: the camera is carried.
    span_s, ends_s: over which an acceleration is taken, and its velocities. windows: accelerations that are judged
    together. slow_m_s: standard deviation of a velocity by odometry, above which there is none. accel_sigma: what
    remains of an accelerometer's scale (four nodding homes, right mounts: 0.9 to 1.2).
    judged_s: of stream, before anything is said. wrong_share, sigmas: by which the height is wrong.
    """

    every_s: float = 0.2
    fewest: int = 10
    kept: int = 100
    loose: float = 0.25
    span_s: float = 1.2
    ends_s: float = 0.3
    windows: int = 60
    slow_m_s: float = 0.15
    accel_sigma: float = 0.08
    judged_s: float = 10.0
    wrong_share: float = 0.25
    sigmas: float = 2.6


class HeightCheck:
    """Reports once that the lens must be higher or lower than the mount has it.

    Objects of a class are alike within a home, so each class counts as one observation with the scatter of its kind. An
    accelerometer tells the odometry's scale, which is the height's, where no wheels are in it. Not judged: a height
    that depth or recorded poses give, and a camera that is carried.
    """

    def __init__(self, mount: Mount, rule: HeightRule | None = None) -> None:
        self._rule, self._given_m = rule or HeightRule(), mount.height_m
        self._arm_m = np.array([mount.forward_m, mount.left_m])
        self._reported = False
        self._looked_s = self._judged_s = -math.inf
        self.reset()

    def reset(self) -> None:
        """Forget what was gathered: the camera looks otherwise than was thought."""
        rule = self._rule
        self._sizes: dict[str, deque[tuple[float, float]]] = defaultdict(lambda: deque(maxlen=rule.kept))
        self._windows: deque[np.ndarray] = deque(maxlen=rule.windows)
        self._steps: list[MovedStep] = []
        self._began_s, self._last = math.inf, (-2, -math.inf)

    def judge(self, frame: Frame, camera: FloorCamera, boxes: Detections, motion: Motion) -> str:
        """The fault after one more frame with a good picture; empty where there is none or it was reported before."""
        attitude = frame.attitude
        if self._reported or (attitude and attitude.height_m is not None):
            return ""
        if attitude and (attitude.fault or attitude.carried):
            self.reset()
        self._began_s = min(self._began_s, frame.stamp_s)
        self._take_step(frame, camera, motion)
        if frame.stamp_s - self._looked_s >= self._rule.every_s:
            self._looked_s = frame.stamp_s
            for found in lens_heights(boxes, camera):
                self._sizes[found.label].append((math.log(found.height_m / self._given_m), found.fall))
        due = frame.stamp_s - max(self._judged_s + 1.0, self._began_s + self._rule.judged_s) >= 0.0
        return self._fault(frame.stamp_s) if due else ""

    def _take_step(self, frame: Frame, camera: FloorCamera, motion: Motion) -> None:
        (index, last_s), self._last = self._last, (frame.index, frame.stamp_s)
        span_s, moved = frame.stamp_s - last_s, motion.moved()
        wheels = any(answer == "used" and name.startswith("wheel") for name, answer in motion.members.items())
        if not len(frame.imu) or frame.index != index + 1 or span_s <= 0.0 or moved is None or wheels:
            self._steps = []
            return
        if math.sqrt(moved[1][0, 0]) > self._rule.slow_m_s * span_s:
            self._steps = []
            return
        to_base = camera.mount.rotation_base_optical()
        force, rate = to_base @ frame.imu.accel_m_s2.mean(axis=0), to_base @ frame.imu.gyro_rad_s.mean(axis=0)
        self._steps.append(MovedStep(span_s, force[:2], float(rate[2]), moved[0].vector()[:2] / span_s))
        if sum(step.span_s for step in self._steps) >= self._rule.span_s:
            self._windows.append(accelerations(self._steps, self._rule.ends_s, self._arm_m))
            self._steps = self._steps[len(self._steps) // 2 :]

    def _fault(self, stamp_s: float) -> str:
        rule, self._judged_s = self._rule, stamp_s
        said, weights, labels = [], [], []
        for label, seen in self._sizes.items():
            if len(seen) < rule.fewest:
                continue
            (middle, fall), (scatter, _) = median_and_scatter(np.array(seen))
            if scatter > rule.loose:
                continue
            pitch = FloorNoise().pitch_rad / fall
            said.append(float(middle))
            weights.append(1.0 / (HEIGHT_M[label][1] ** 2 + pitch**2 + scatter**2 / rule.fewest))
            labels.append(label)
        if (found := scale_of(np.array(self._windows))) is not None:
            said.append(found[0])
            weights.append(1.0 / (found[1] ** 2 + rule.accel_sigma**2))
        if not said:
            return ""
        off = float(np.average(said, weights=weights))
        scatter2 = float(np.square(np.array(said) - off) @ weights) / max(len(said) - 1, 1)
        sigma = math.sqrt(max(scatter2, 1.0) / sum(weights))  # of what disagrees more than it says (Birge 1932)
        if abs(off) < max(math.log1p(rule.wrong_share), rule.sigmas * sigma):
            return ""
        self._reported = True
        sources = [f"the usual height of {', '.join(labels)}"] if labels else []
        sources += ["the accelerometer"] if found else []
        return (
            f"mount: height {self._given_m:.2f} m given, {' and '.join(sources)} would make it "
            f"{self._given_m * math.exp(off):.2f} m, to {100.0 * sigma:.0f} %: measure it again"
        )
