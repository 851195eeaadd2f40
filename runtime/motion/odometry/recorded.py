"""Odometry that was recorded with the pictures: true poses, a TUM file, wheel odometry."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from edgemap.geometry.camera.attitude import Attitude
from edgemap.geometry.se2 import SE2
from edgemap.runtime.frames.errors import OdometryError
from edgemap.runtime.frames.faults import Fault, FaultKind
from edgemap.runtime.frames.trajectory import EDGE_S, PoseTrack
from edgemap.runtime.motion.odometry.protocol import STILL, Motion, Odometry, blind_motion, first_motion, no_motion


@dataclass(frozen=True, slots=True)
class DriftRate:
    """Errors of a recorded motion. roughness_m: standard deviation of the place per square root of a metre that wheels
    roll: small slips add up like a random walk (Chong and Kleeman 1997); 0 for poses that are taken as they are.
    half_track_m: what a wheel rolls per radian of rotation, which makes a slip a turn.
    """

    roughness_m: float = 0.0
    half_track_m: float = 0.15

    def rolled_m(self, motion: SE2) -> float:
        """What the faster wheel rolls in one motion."""
        return math.hypot(motion.x_m, motion.y_m) + self.half_track_m * abs(motion.yaw_rad)

    def covariance(self, motion: SE2) -> NDArray[np.float64]:
        """Covariance of one motion, (3, 3)."""
        slip2, half_track_m = self.roughness_m**2 * self.rolled_m(motion), max(self.half_track_m, ROUNDED_M)
        return np.diag([slip2 + ROUNDED_M**2] * 2 + [slip2 / half_track_m**2 + ROUNDED_RAD**2])


ROUNDED_M, ROUNDED_RAD = 1e-4, 1e-5  # of what files hold
# A small robot with two driven wheels on hard floors. 5 mm are the slips of the simulator's wheels; for the whole drive
# their radius errs by 1 % and their distance by 2 % (24 homes: NEES over 5 s 1.36 (0.3 to 3.7) with 5 mm, 1.06 (0.4 to
# 2.9) with 6.5; drift over 5 m 0.97 and 0.87 %).
WHEEL = DriftRate(0.0065)
FASTEST_M_S = 3.0  # that a small robot's wheel rolls; a faster change between two samples is a jump, not a motion
ROUNDED_S = 0.01  # outside the wheels' samples that still count as their end: stamps are rounded
LONGEST_GAP_S, LONGEST_GAP_PERIODS = 0.5, 5.0  # between two samples; a longer one is a hole, not a straight line


class RecordedOdometry(Odometry):
    """Motion between the stamps of two frames, read off a recorded trajectory of the base.

    A recording that ends, starts late, has a hole or a pose that is not finite gives no motion there, with a fault that
    names it, and measures again where it covers both ends of a step.
    """

    def __init__(self, trajectory: PoseTrack, name: str, drift: DriftRate | None = None) -> None:
        self.name = name
        self.trajectory = trajectory
        self._drift = drift or DriftRate()
        self._kind, self._edge_s = FaultKind.POSES, EDGE_S
        if self._drift.roughness_m:
            self._kind, self._edge_s = FaultKind.WHEELS, ROUNDED_S
        period_s = float(np.median(np.diff(trajectory.stamps_s))) if len(trajectory.poses) > 1 else 0.0
        self._longest_gap_s = max(LONGEST_GAP_S, LONGEST_GAP_PERIODS * period_s)
        self._last: SE2 | None = None
        self._last_s = -math.inf

    def step_blind(self, stamp_s: float, reason: Fault | None, attitude: Attitude | None = None) -> Motion:  # noqa: ARG002
        """The recorded motion since the last step: it needs no picture."""
        pose, fault = self._pose(stamp_s)
        last, self._last, first = self._last, pose, not math.isfinite(self._last_s)
        self._last_s = stamp_s
        if first and not fault:
            return first_motion()
        if fault or last is None or pose is None:
            text = fault or f"measured again from {stamp_s:.3f} s on"
            return blind_motion(Fault(self._kind, f"odometry {self.name}: {text}"))
        motion = last.inverse() @ pose
        return Motion(motion, self._drift.covariance(motion))

    def still(self, stamp_s: float, attitude: Attitude | None) -> bool | None:  # noqa: ARG002
        """Whether the recorded motion since the last step is zero."""
        pose, fault = self._pose(stamp_s)
        if self._last is None or pose is None or fault:
            return None
        return (self._last.inverse() @ pose).is_within(STILL)

    def rest(self, stamp_s: float) -> Motion:
        """Zero motion; continues from the stamp."""
        self.step_blind(stamp_s, None)
        return no_motion()

    def _pose(self, stamp_s: float) -> tuple[SE2 | None, str]:
        """The pose at a stamp, and why there is none or no valid motion to it; empty where there is."""
        try:
            pose = self.trajectory.at(stamp_s, self._edge_s)
        except OdometryError as error:
            return None, str(error)
        if not np.isfinite(pose.vector()).all():
            return None, f"pose at {stamp_s:.3f} s is not finite"
        return pose, self._broken(stamp_s)

    def _broken(self, stamp_s: float) -> str:
        """Why the samples of a step to a stamp are no valid motion (a hole or a jump); empty where they are."""
        stamps, poses = self.trajectory.stamps_s, self.trajectory.poses
        if not math.isfinite(self._last_s):
            return ""
        first = max(int(np.searchsorted(stamps, self._last_s, side="right")) - 1, 0)
        last = min(int(np.searchsorted(stamps, stamp_s)), len(stamps) - 1)
        for at in range(first, last):
            span_s, moved = float(stamps[at + 1] - stamps[at]), poses[at].inverse() @ poses[at + 1]
            both = abs(stamps[at] - self._last_s) <= ROUNDED_S and abs(stamps[at + 1] - stamp_s) <= ROUNDED_S
            if span_s > self._longest_gap_s and not both:  # between samples at both pictures nothing is interpolated
                return f"no sample from {stamps[at]:.3f} to {stamps[at + 1]:.3f} s"
            if self._drift.roughness_m and self._drift.rolled_m(moved) > FASTEST_M_S * span_s:
                far_m = math.hypot(moved.x_m, moved.y_m)
                return f"jumps by {far_m:.2f} m and {moved.yaw_rad:.2f} rad in {span_s:.3f} s: left out"
        return ""
