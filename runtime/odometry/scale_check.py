"""Whether camera and wheels agree on how far the robot went: a wrong height scales every motion of the camera."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

import numpy as np

from edgemap.geometry.odometry.covariance_intersection import MotionEstimate
from edgemap.geometry.robust import median_and_scatter
from edgemap.geometry.se2 import SE2


@dataclass(frozen=True, slots=True)
class ScaleRule:
    """When camera and wheels disagree on the scale.

    window_m: travelled by the wheels between two comparisons, at most most_yaw_rad apart. windows, fewest: that are
    judged together. wrong_share: relative difference; the camera alone drifts up to 10 % in rendered homes with the
    right mount. sigmas: standard errors of the median ratio. nees: mean squared difference, in units of the stated
    variance.
    """

    window_m: float = 0.5
    most_yaw_rad: float = math.radians(30.0)
    windows: int = 20
    fewest: int = 8
    wrong_share: float = 0.15
    sigmas: float = 4.0
    nees: float = 4.0


class NoScaleCheck:
    """Where nothing can be compared."""

    def judge(self, camera: MotionEstimate | None, wheels: MotionEstimate | None) -> str:  # noqa: ARG002
        """No fault."""
        return ""


class ScaleCheck:
    """Reports once that wheels and camera differ in length by more than both state. height_m: of the lens as given."""

    def __init__(self, height_m: float, rule: ScaleRule | None = None) -> None:
        self._height_m, self._rule = height_m, rule or ScaleRule()
        self._found: deque[tuple[float, float, float]] = deque(maxlen=self._rule.windows)  # ratio, variance of it, NEES
        self._reported = False
        self.reset()

    def reset(self) -> None:
        """Begin a window; those that are complete stay."""
        self._camera, self._wheels, self._variance = SE2(), SE2(), 0.0

    def judge(self, camera: MotionEstimate | None, wheels: MotionEstimate | None) -> str:
        """The fault after one more step's two motions; empty where there is none or it was reported before. None: not
        measured."""
        if camera is None or wheels is None:
            self.reset()
            return ""
        self._camera, self._wheels = self._camera @ SE2(*camera.motion), self._wheels @ SE2(*wheels.motion)
        self._variance += float(np.trace(camera.covariance[:2, :2] + wheels.covariance[:2, :2])) / 2.0
        rolled_m = math.hypot(self._wheels.x_m, self._wheels.y_m)
        rotated = abs(self._wheels.yaw_rad) > self._rule.most_yaw_rad
        if rolled_m < self._rule.window_m and not rotated:
            return ""
        if not rotated:
            seen_m = math.hypot(self._camera.x_m, self._camera.y_m)
            nees = (seen_m - rolled_m) ** 2 / max(self._variance, 1e-12)
            self._found.append((seen_m / rolled_m, self._variance / rolled_m**2, nees))
        self.reset()
        return "" if rotated or self._reported else self._fault()

    def _fault(self) -> str:
        rule, found = self._rule, np.array(self._found)
        if len(found) < rule.fewest:
            return ""
        ratio, scatter = map(float, median_and_scatter(found[:, 0]))
        error = scatter / math.sqrt(len(found))
        off = abs(math.log(max(ratio, 1e-3)))
        if off < max(math.log1p(rule.wrong_share), rule.sigmas * error) or found[:, 2].mean() < rule.nees:
            return ""
        self._reported = True
        stated = 100.0 * math.sqrt(float(found[:, 1].mean()))
        return (
            f"mount: the camera measures {100.0 * (ratio - 1.0):+.0f} % of what the wheels rolled over "
            f"{len(found) * rule.window_m:.1f} m, {stated:.0f} % are stated: the lens would be "
            f"{self._height_m / ratio:.2f} m above the floor, not {self._height_m:.2f} m, or the wheels are wrong"
        )
