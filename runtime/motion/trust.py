"""Decides whether a motion source is trusted, by comparing its motions with those of the camera."""

import math
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, replace
from enum import Enum

import numpy as np

from edgemap.geometry.odometry.consensus import MotionEstimate
from edgemap.geometry.robust import CLEAR_SIGMAS
from edgemap.geometry.se2 import SE2
from edgemap.runtime.frames.faults import Fault, FaultKind
from edgemap.runtime.motion.judge import LEAST, MotionJudge, path_of, share_text

# Ratio of the source's motion to the camera's. On two bad drives, the camera was compared with correct wheels in 470
# windows. 8 windows were outside `ratio`, two of them in a row, and none was below 0.15: these are camera errors.
CONTRARY = 0.1
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

    least: tuple[float, float] = LEAST  # motion of the reference in a conclusive window: yaw in rad, length in m
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


class WheelTrust:
    """Judges wheels by the camera: yaw and length, and their delay."""

    def __init__(self, rule: TrustRule) -> None:
        state = Trust.UNPROVEN if rule.windows else Trust.TRUSTED
        names = "yaw", "length"
        self._parts = {name: Agreement(rule, least, state) for name, least in zip(names, rule.least, strict=True)}
        self._judge, self._path = MotionJudge(least=rule.least), deque[tuple[float, SE2]]()
        self._judges, self._late, self._excluded = rule.windows > 0, "", False

    def judge(
        self, wheels: MotionEstimate | None, camera: MotionEstimate | None, from_s: float, to_s: float
    ) -> Fault | None:
        """Compare one step; a fault in the step from which on the wheels are excluded, or used again. from_s: stamp of
        the step before."""
        self._follow(wheels, to_s)
        if wheels is None or camera is None:
            self._parts = {name: part.restarted() for name, part in self._parts.items()}
            return None
        for name, at in (("yaw", 2), ("length", 0)):
            variance = float(camera.covariance[at, at] + wheels.covariance[at, at])
            self._parts[name] = self._parts[name].updated(float(wheels.motion[at]), float(camera.motion[at]), variance)
        if self._judges and self._judge.add(from_s, to_s, (SE2(*camera.motion.tolist()), camera.covariance)):
            stamps_s, poses = zip(*self._path, strict=True)
            self._late = self._judge.delay(path_of(np.array(stamps_s), np.array([pose.vector() for pose in poses])))
        wrong = self._wrong()
        news, self._excluded = bool(wrong) != self._excluded, bool(wrong)
        if not news:
            return None
        if not wrong:
            return Fault(FaultKind.WHEELS_RESTORED, f"{WHEELS}: agrees with the camera again: used again")
        return Fault(FaultKind.WHEELS_EXCLUDED, f"{WHEELS}: {wrong}: left out")

    def _follow(self, wheels: MotionEstimate | None, to_s: float) -> None:
        """Adds a step to the wheels' path, which begins again where they measured none."""
        before = self._path[-1][1] if self._path else SE2()
        if wheels is None:
            self._path.clear()
        self._path.append((to_s, before if wheels is None else before @ SE2(*wheels.motion.tolist())))
        while self._path[-1][0] - self._path[0][0] > self._judge.reach_s:
            self._path.popleft()

    def _wrong(self) -> str:
        """Why the wheels are left out; empty where they are not."""
        if self._late:
            return self._late
        for name, part in self._parts.items():
            if part.state is Trust.DISTRUSTED:
                return share_text(name, part.ratio, 1.0 - part.rule.ratio)
        return ""

    def trusted(self, estimates: Mapping[str, MotionEstimate], camera: bool) -> dict[str, MotionEstimate]:
        """The estimates without distrusted wheels. With a camera, quantities of the wheels that have not been confirmed
        yet have no weight."""
        wheels = estimates.get(WHEELS)
        if wheels is None or self._excluded:
            return {name: item for name, item in estimates.items() if name != WHEELS}
        doubted = any(part.doubted for part in self._parts.values())
        yaw, length = (part.state is Trust.TRUSTED and not doubted for part in self._parts.values())
        yaw &= self._judge.conclusive or not self._judges  # late wheels turn in other pictures
        if camera and not (yaw and length):
            loose = np.diag(np.where([length, length, yaw], 0.0, UNPROVEN))
            wheels = MotionEstimate(wheels.motion, wheels.covariance + loose)
        return {**estimates, WHEELS: wheels}
