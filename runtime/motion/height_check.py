"""Estimates the height of the lens by depth, objects on the floor and wheels; checks a stated one, corrects a guess."""

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from edgemap.geometry.camera.attitude import Attitude
from edgemap.geometry.camera.floor import FloorCamera, FloorNoise
from edgemap.geometry.camera.mount import HeightEstimate, Mount
from edgemap.geometry.observations.detections import Detections
from edgemap.geometry.observations.lens_height import HeightBySizes, HeightMeasurement, agreed_height
from edgemap.geometry.robust import CLEAR_SIGMAS, FEWEST, median_and_scatter
from edgemap.runtime.frames.faults import Fault, FaultKind
from edgemap.runtime.frames.limits import EVERY_S
from edgemap.runtime.frames.timing import StreamTimer
from edgemap.runtime.motion.odometry.protocol import Motion

KEPT = 100  # of each kind, a bound on memory
DEPTH_SIGMA = 0.02  # of a depth camera's scale, by its datasheet (RealSense D435: 2 % at 2 m)


@dataclass(frozen=True, slots=True)
class HeightRule:
    """When a configured height counts as wrong, and a guessed one as another."""

    wheels_sigma: float = 0.05  # standard deviation of the wheels' radius, relative
    judged_s: float = 10.0  # stream time before the first report
    wrong_share: float = 0.25  # least relative error of a wrong height without depth


class TravelWindows:
    """Paths by the camera and by the wheels, m, over windows of travel. window_m: of each, by the wheels. windows: the
    newest ones, `most` of them."""

    def __init__(self, window_m: float, most: int | None = None) -> None:
        self._window_m, self.windows = window_m, deque[tuple[float, float]](maxlen=most)
        self._camera_m = self._rolled_m = 0.0  # in the window so far

    def add(self, lengths: tuple[float, float] | None) -> None:
        """One frame, as of `Motion.lengths`; a window begins again where one of both measured none."""
        camera_m, rolled_m = lengths or (0.0, 0.0)
        self._camera_m, self._rolled_m = self._camera_m + camera_m, self._rolled_m + rolled_m
        if done := abs(self._rolled_m) >= self._window_m:
            self.windows.append((self._camera_m, self._rolled_m))
        if done or lengths is None:
            self._camera_m = self._rolled_m = 0.0

    @property
    def ratios(self) -> list[float]:
        """The wheels' path over the camera's, of each window."""
        return [rolled_m / (camera_m or 1e-3) for camera_m, rolled_m in self.windows]


class HeightCheck:
    """Estimates the lens's height. A stated one that is clearly wrong is reported once; a guessed one is corrected.

    Wheels measure the camera's scale; where the other measurements are nearer to a stated height than to the wheels',
    the wheels are wrong. A height from recorded poses, and a carried camera, are not checked. guessed: standard
    deviation of a guessed height, as a share; 0 for a stated one. estimate: None before the first measurement. scale:
    factor for all lengths that follow from the mount's height; 1 for a stated height, and from the first frame in which
    wheels or depth measure lengths.
    """

    def __init__(self, mount: Mount, rule: HeightRule | None = None, guessed: float = 0.0) -> None:
        self._rule, self._stated_m, self._guessed = rule or HeightRule(), mount.height_m, guessed
        self.estimate: HeightEstimate | None = None
        self.scale, self._measured = 1.0, False  # whether lengths are measured, not in proportion to the height
        self._reported, self._used = False, mount
        self._timer, self._sizes_timer = StreamTimer(EVERY_S), StreamTimer(EVERY_S)
        self.reset()

    def reset(self) -> None:
        """Discards all measurements, as of a carried camera."""
        self._sizes = HeightBySizes(KEPT)
        self._travel = TravelWindows(self._stated_m, KEPT)  # as long as the lens is high
        self._depths: deque[float] = deque(maxlen=KEPT)  # logarithms of depth's height over the mount's
        self._began_s = math.inf

    def judge(
        self, stamp_s: float, camera: FloorCamera, boxes: Detections, motion: Motion, depth: bool = False
    ) -> Fault | None:
        """The fault after one more frame with a good picture; None where there is none or it was reported before.
        camera: with the attitude of the frame. depth: whether the frame brings any."""
        attitude = camera.attitude or Attitude.of_mount(camera.mount)
        used = attitude.mount.used if attitude.mount else self._used
        if attitude.carried:
            self.reset()
        elif used != self._used:
            self._sizes.turn(used.rotation_base_optical() @ self._used.rotation_base_optical().T)
            self._travel.windows.clear()  # of motions by other angles
        self._used = used
        self._began_s = min(self._began_s, stamp_s)
        if depth or motion.lengths is not None:
            self.scale, self._measured = 1.0, True
        if attitude.height_m is None:
            self._travel.add(motion.lengths)
            if self._sizes_timer.due(stamp_s):
                self._sizes.add(boxes, camera)
        elif attitude.source == "depth":
            self._depths.append(math.log(attitude.height_m / self._stated_m))
        due = stamp_s >= self._began_s + self._rule.judged_s and self._timer.due(stamp_s)
        return self._judge() if due else None

    def _by(self, name: str, values: Sequence[float], least_sigma: float) -> HeightMeasurement | None:
        """A measurement from logarithms of ratios to the mount's height; None for too few or one that is not finite."""
        if len(values) < FEWEST or not np.isfinite(values).all():
            return None
        middle, scatter = map(float, median_and_scatter(np.array(values)))
        sigma = math.hypot(scatter / math.sqrt(len(values)), least_sigma)
        return HeightMeasurement(name, math.log(self._stated_m) + middle, sigma)

    def _judge(self) -> Fault | None:
        rule, stated = self._rule, math.log(self._stated_m)
        wrong = math.log1p(rule.wrong_share)
        measurements = self._sizes.measurements(FloorNoise().tilt_rad, FEWEST)
        # Most of a guess came from the same objects: they are used where they measure better than it.
        holds = self._guessed and not (measurements and agreed_height(measurements)[1] < self._guessed)
        measurements = [] if holds else measurements
        labels = ", ".join(one.name for one in measurements)
        sources = [f"the usual height of {labels}"] if labels else []
        depth = self._by("the floor in depth pictures", self._depths, DEPTH_SIGMA)
        ratios = [math.log(ratio) if ratio > 0.0 else math.nan for ratio in self._travel.ratios]
        wheels = self._by("the wheels", ratios, rule.wheels_sigma)
        for more in filter(None, (depth, wheels)):
            if more is wheels and measurements and abs(more.log_m - stated) > wrong and not self._guessed:
                by_others = agreed_height(measurements)[0]
                if abs(more.log_m - by_others) > abs(stated - by_others):
                    continue  # the others are nearer to the stated height than to the wheels': the wheels are wrong
            measurements.append(more)
            sources.append(more.name)
        if not measurements:
            if holds:
                self.estimate, self.scale = None, 1.0
            return None
        if holds:
            measurements.append(HeightMeasurement("the guess", stated, self._guessed))
        log_m, sigma = agreed_height(measurements)
        self.estimate = HeightEstimate(math.exp(log_m), math.exp(log_m) * sigma)
        if self._guessed:
            if not self._measured:
                self.scale = self.estimate.height_m / self._stated_m
            return None
        if self._reported or abs(log_m - stated) < max(0.0 if depth else wrong, CLEAR_SIGMAS * sigma):
            return None
        self._reported = True
        return Fault(
            FaultKind.MOUNT_HEIGHT,
            f"mount: height {self._stated_m:.2f} m given, {' and '.join(sources)} would make it "
            f"{self.estimate.height_m:.2f} m, to {100.0 * sigma:.0f} %: measure it again",
        )
