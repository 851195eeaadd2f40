"""Decides whether a motion source is trusted, by comparing its motions with those of the camera."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from enum import Enum

import numpy as np

from edgemap.geometry.arrays import Array
from edgemap.geometry.odometry.consensus import MotionEstimate, difference
from edgemap.geometry.robust import CLEAR_SIGMAS
from edgemap.runtime.frames.faults import Fault, FaultKind

# Ratio of the source's motion to the camera's. On two bad drives, the camera was compared with correct wheels in 470
# windows. 8 windows were outside `ratio`, two of them in a row, and none was below 0.15: these are camera errors.
CONTRARY = 0.1
# Length of a window, s; weight of the newest window in the mean; maximum squared distance of one window.
INNOVATION_S, INNOVATION_SHARE, MOST_SQUARED = 1.0, 0.3, 30.0
WHEELS = "wheels"  # the source
UNPROVEN = np.array([100.0, 100.0, 10.0])  # variances added to quantities that a source has not confirmed yet


class Trust(Enum):
    """State of a source. UNPROVEN: not confirmed yet, or not confirmed since it reported standstill or reverse while
    the camera moved. TRUSTED: confirmed. DISTRUSTED: several consecutive windows contradict it.
    """

    UNPROVEN = "unproven"
    TRUSTED = "trusted"
    DISTRUSTED = "distrusted"


@dataclass(frozen=True, slots=True)
class TrustRule:
    """Decides when a source with valid numbers is wrong."""

    least: tuple[float, float] = (0.12, 0.2)  # motion of the reference in a conclusive window: yaw in rad, length in m
    # Minimum ratio of the source's motion to the reference's, and of the reference's to the source's. Up to it, a scale
    # error explains the difference: for yaw of a lens or a wheel track, for length of a height or a wheel radius.
    ratio: float = 0.75
    windows: int = 3  # consecutive windows that change the state in either direction; 0: the source is always trusted


@dataclass(frozen=True, slots=True)
class Agreement:
    """Agreement of one quantity (yaw or length) of a source with a reference. Call `updated` with each step.

    measured, reference, variance: sums over the current window. ratio: of the last conclusive window. row: number of
    consecutive windows that confirm the source; negative for windows that contradict it.
    """

    rule: TrustRule
    least: float
    state: Trust = Trust.UNPROVEN
    measured: float = 0.0
    reference: float = 0.0
    variance: float = 0.0
    ratio: float = 1.0
    row: int = 0

    def updated(self, measured: float, reference: float, variance: float) -> "Agreement":
        """The agreement after one more step. variance: of the difference, from the stated variances of both sources."""
        if not self.rule.windows:
            return self
        sums = self.measured + measured, self.reference + reference, self.variance + variance
        window = replace(self, measured=sums[0], reference=sums[1], variance=sums[2])
        if abs(window.reference) < max(self.least, window._clear):
            return window
        return window._judged()

    def restarted(self) -> "Agreement":
        """Starts a new window, because there was no reference."""
        return replace(self, measured=0.0, reference=0.0, variance=0.0)

    @property
    def _clear(self) -> float:
        """Motion beyond which the window's sums are clearly more than their errors."""
        return CLEAR_SIGMAS * math.sqrt(self.variance)

    @property
    def doubted(self) -> bool:
        """Whether the source reports standstill or reverse while the reference moves, or was contradicted while it was
        unproven.
        """
        moves = min(abs(self.reference), abs(self.measured - self.reference)) > self._clear
        stands = moves and self.measured / self.reference < CONTRARY
        return stands or (self.row < 0 and self.state is Trust.UNPROVEN)

    def _judged(self) -> "Agreement":
        """Evaluates the completed window: it confirms or contradicts the source."""
        ratio, least = self.measured / self.reference, self.rule.ratio
        against = abs(self.measured - self.reference) > self._clear and not least < ratio < 1.0 / least
        row = min(self.row, 0) - 1 if against else max(self.row, 0) + 1
        state = Trust.UNPROVEN if against and ratio < CONTRARY and self.state is Trust.TRUSTED else self.state
        if abs(row) >= self.rule.windows:
            state = Trust.DISTRUSTED if row < 0 else Trust.TRUSTED
        elif row > 0 and state is Trust.UNPROVEN:
            state = Trust.TRUSTED
        return replace(self.restarted(), ratio=ratio, row=row, state=state)


@dataclass(frozen=True, slots=True, eq=False)
class Innovation:
    """Consistency of two sources: their difference relative to both stated covariances. If it exceeds them, the stated
    covariances are too small. difference (3,), covariance (3, 3), span_s: sums over the current window. mean: recent
    mean of the windows' squared Mahalanobis distances per degree of freedom (innovation-based adaptive estimation:
    Mehra 1970).
    """

    difference: Array = field(default_factory=lambda: np.zeros(3))
    covariance: Array = field(default_factory=lambda: np.zeros((3, 3)))
    span_s: float = 0.0
    mean: float = 1.0

    @property
    def scale(self) -> float:
        """Factor by which the stated covariances are multiplied, at least 1."""
        return max(self.mean, 1.0)

    def updated(self, difference: Array, covariance: Array, span_s: float) -> "Innovation":
        """The state after one more step. covariance: of the difference of both motions, as stated by the sources."""
        summed, together, span_s = self.difference + difference, self.covariance + covariance, self.span_s + span_s
        if span_s < INNOVATION_S:
            return Innovation(summed, together, span_s, self.mean)
        squared = min(float(summed @ np.linalg.solve(together, summed)) / len(summed), MOST_SQUARED)
        return Innovation(mean=self.mean + INNOVATION_SHARE * (squared - self.mean))


class WheelTrust:
    """Judges wheels by yaw and length, and by their difference from the camera beyond both covariances."""

    def __init__(self, rule: TrustRule) -> None:
        state = Trust.UNPROVEN if rule.windows else Trust.TRUSTED
        self._yaw, self._length = (Agreement(rule, least, state) for least in rule.least)
        self._innovation, self._excluded = Innovation(), False

    @property
    def scale(self) -> float:
        """Factor on the fused covariance."""
        return self._innovation.scale

    def judge(self, wheels: MotionEstimate | None, camera: MotionEstimate | None, dt_s: float) -> Fault | None:
        """Compare one step; a fault in the step from which on the wheels are excluded, or used again."""
        if wheels is None or camera is None:
            self._yaw, self._length = self._yaw.restarted(), self._length.restarted()
            return None
        (x_m, _, yaw_rad), (camera_m, _, camera_rad) = wheels.motion.tolist(), camera.motion.tolist()
        together = np.asarray(camera.covariance + wheels.covariance)
        self._yaw = self._yaw.updated(yaw_rad, camera_rad, float(together[2, 2]))
        self._length = self._length.updated(x_m, camera_m, float(together[0, 0]))
        wrong = [(name, part) for name, part in self._parts if part.state is Trust.DISTRUSTED]
        news, self._excluded = bool(wrong) != self._excluded, bool(wrong)
        if wrong:
            self._innovation = Innovation()  # the difference from a faulty source is no error of the others
        else:
            self._innovation = self._innovation.updated(difference(camera, wheels), together, dt_s)
        if not news:
            return None
        if not wrong:
            return Fault(FaultKind.WHEELS_RESTORED, f"{WHEELS}: agrees with the camera again: used again")
        name, part = wrong[0]
        text = f"{WHEELS}: its {name} is {100.0 * part.ratio:.0f} % of what the camera measures: left out"
        return Fault(FaultKind.WHEELS_EXCLUDED, text)

    def trusted(self, estimates: Mapping[str, MotionEstimate], camera: bool) -> dict[str, MotionEstimate]:
        """The estimates without distrusted wheels. With a camera, quantities of the wheels that have not been confirmed
        yet have no weight."""
        trusted = dict(estimates)
        wheels = trusted.pop(WHEELS, None)
        if wheels is None or self._excluded:
            return trusted
        doubted = self._yaw.doubted or self._length.doubted
        yaw, length = (part.state is Trust.TRUSTED and not doubted for _, part in self._parts)
        if camera and not (yaw and length):
            loose = np.diag(np.where([length, length, yaw], 0.0, UNPROVEN))
            wheels = MotionEstimate(wheels.motion, wheels.covariance + loose)
        return {name: wheels if name == WHEELS else item for name, item in estimates.items()}

    @property
    def _parts(self) -> tuple[tuple[str, Agreement], tuple[str, Agreement]]:
        """What is compared, by name."""
        return ("yaw", self._yaw), ("length", self._length)
