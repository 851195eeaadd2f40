"""Checks the lens's height against depth pictures, objects on the floor, and wheels."""

import math
from collections import defaultdict, deque
from dataclasses import dataclass

import numpy as np

from edgemap.geometry.camera.attitude import Attitude
from edgemap.geometry.camera.floor import FloorCamera, FloorNoise
from edgemap.geometry.camera.mount import HeightEstimate, Mount
from edgemap.geometry.observations.class_extents import HEIGHT_M
from edgemap.geometry.observations.detections import Detections
from edgemap.geometry.observations.lens_height import lens_heights
from edgemap.geometry.robust import CLEAR_SIGMAS, median_and_scatter
from edgemap.runtime.motion.odometry.protocol import Motion


@dataclass(frozen=True, slots=True)
class HeightRule:
    """When a mount's height counts as wrong.

    fewest, kept: measurements of one kind: boxes of a class, depth pictures with a floor, stretches of window_m over
    which wheels and camera are compared. wheels_sigma: of the wheels' radius; depth_sigma: of a depth camera's scale.
    judged_s: stream time before the first report. wrong_share: least relative error of a wrong height without depth,
    and scatter of a class's boxes above which they do not count: the camera is carried.
    """

    fewest: int = 10
    kept: int = 100
    window_m: float = 0.5
    wheels_sigma: float = 0.05
    depth_sigma: float = 0.02
    judged_s: float = 10.0
    wrong_share: float = 0.25


@dataclass(frozen=True, slots=True)
class _Measurement:
    """log_share: logarithm of its height over the mount's. sigma: standard deviation of that."""

    name: str
    log_share: float
    sigma: float


class HeightCheck:
    """Estimates the lens's height, and reports once if it is higher or lower than the mount's.

    Objects of a class are alike within a home, so each class is one measurement with the scatter of its heights. Wheels
    measure the camera's scale; where the others are nearer to the mount's height than to the wheels', the wheels are
    wrong. A height from recorded poses, and a carried camera, are not checked. estimate: None before the first
    measurement.
    """

    def __init__(self, mount: Mount, rule: HeightRule | None = None) -> None:
        self._rule, self._given_m = rule or HeightRule(), mount.height_m
        self.estimate: HeightEstimate | None = None
        self._reported, self._used = False, mount
        self._judged_s = -math.inf
        self.reset()

    def reset(self) -> None:
        """Discards all measurements, after the camera's attitude was corrected."""
        rule = self._rule
        self._sizes: dict[str, deque[tuple[float, float]]] = defaultdict(lambda: deque(maxlen=rule.kept))
        self._ratios: deque[float] = deque(maxlen=rule.kept)  # logarithms of wheels over camera
        self._depths: deque[float] = deque(maxlen=rule.kept)  # logarithms of depth's height over the mount's
        self._camera_m = self._rolled_m = 0.0  # in the window so far
        self._began_s = math.inf

    def judge(self, stamp_s: float, camera: FloorCamera, attitude: Attitude, boxes: Detections, motion: Motion) -> str:
        """The fault after one more frame with a good picture; empty where there is none or it was reported before."""
        used = attitude.mount.used if attitude.mount else self._used
        if used != self._used or attitude.carried:
            self.reset()
        self._used = used
        self._began_s = min(self._began_s, stamp_s)
        if attitude.height_m is None:
            self._compare(motion)
            self._measure(camera, boxes)
        elif attitude.source == "depth":
            self._depths.append(math.log(attitude.height_m / self._given_m))
        due = stamp_s - max(self._judged_s + 1.0, self._began_s + self._rule.judged_s) >= 0.0
        return self._judge(stamp_s) if due else ""

    def _measure(self, camera: FloorCamera, boxes: Detections) -> None:
        """What stands on the floor."""
        for found in lens_heights(boxes, camera):
            self._sizes[found.label].append((math.log(found.height_m / self._given_m), found.fall))

    def _compare(self, motion: Motion) -> None:
        """What the wheels rolled with what the camera measured of it."""
        if motion.lengths is None:
            self._camera_m = self._rolled_m = 0.0
            return
        camera_m, rolled_m = motion.lengths
        self._camera_m, self._rolled_m = self._camera_m + camera_m, self._rolled_m + rolled_m
        if abs(self._rolled_m) >= self._rule.window_m:
            ratio = self._rolled_m / (self._camera_m or 1e-3)
            self._ratios.append(math.log(ratio) if ratio > 0.0 else math.nan)
            self._camera_m = self._rolled_m = 0.0

    def _by_sizes(self) -> list[_Measurement]:
        """One for each class with enough observations."""
        rule, found = self._rule, list[_Measurement]()
        for label, heights in self._sizes.items():
            if len(heights) < rule.fewest:
                continue
            (middle, fall), (scatter, _) = median_and_scatter(np.array(heights))
            if scatter <= rule.wrong_share:
                variance = HEIGHT_M[label][1] ** 2 + (FloorNoise().pitch_rad / fall) ** 2 + scatter**2 / rule.fewest
                found.append(_Measurement(label, float(middle), math.sqrt(variance)))
        return found

    def _by(self, name: str, values: deque[float], least_sigma: float) -> _Measurement | None:
        """Logarithms as a measurement; None for too few, or where one has no meaning."""
        if len(values) < self._rule.fewest or not np.isfinite(values).all():
            return None
        middle, scatter = map(float, median_and_scatter(np.array(values)))
        return _Measurement(name, middle, math.hypot(scatter / math.sqrt(len(values)), least_sigma))

    def _judge(self, stamp_s: float) -> str:
        rule, self._judged_s = self._rule, stamp_s
        wrong = math.log1p(rule.wrong_share)
        measurements = self._by_sizes()
        labels = ", ".join(one.name for one in measurements)
        sources = [f"the usual height of {labels}"] if labels else []
        depth = self._by("the floor in depth pictures", self._depths, rule.depth_sigma)
        wheels = self._by("the wheels", self._ratios, rule.wheels_sigma)
        for more in filter(None, (depth, wheels)):
            share, (off, _) = more.log_share, _agreed(measurements)
            if more is wheels and measurements and abs(share) > wrong and abs(share - off) > abs(off):
                continue  # the others are nearer to the mount's height than to the wheels': the wheels are wrong
            measurements.append(more)
            sources.append(more.name)
        if not measurements:
            return ""
        off, sigma = _agreed(measurements)
        self.estimate = HeightEstimate(self._given_m * math.exp(off), self._given_m * math.exp(off) * sigma)
        if self._reported or abs(off) < max(0.0 if depth else wrong, CLEAR_SIGMAS * sigma):
            return ""
        self._reported = True
        return (
            f"mount: height {self._given_m:.2f} m given, {' and '.join(sources)} would make it "
            f"{self.estimate.height_m:.2f} m, to {100.0 * sigma:.0f} %: measure it again"
        )


def _agreed(measurements: list[_Measurement]) -> tuple[float, float]:
    """Weighted mean of the measurements, and its standard deviation; more where they disagree (Birge 1932)."""
    if not measurements:
        return 0.0, math.inf
    shares, weights = (
        np.array([one.log_share for one in measurements]),
        np.array([one.sigma**-2 for one in measurements]),
    )
    off = float(np.average(shares, weights=weights))
    scatter2 = float((shares - off) ** 2 @ weights) / max(len(shares) - 1, 1)
    return off, math.sqrt(max(scatter2, 1.0) / float(weights.sum()))
