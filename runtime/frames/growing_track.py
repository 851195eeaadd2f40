"""Planar poses that arrive one by one, looked up as a recorded trajectory is."""

import math
from bisect import bisect_right

import numpy as np
from numpy.typing import NDArray

from edgemap.geometry.se2 import SE2
from edgemap.runtime.frames.errors import OdometryError
from edgemap.runtime.frames.trajectory import FASTEST_M_S

KEPT = 500
AHEAD_S = 0.2  # beyond the newest pose, at the latest speed
SPEED_OVER_S = 0.02  # at least, two poses apart
JUMP_M = 0.5  # shorter ones are none; longer ones are where they are faster than wheels
SET_BACK_S = 1.0  # a pose that is older than the newest by less came late


class GrowingTrack:
    """The newest poses, by stamps that go forward. It restarts where a robot's odometry does: at a pose that wheels
    do not reach in the time, or after a clock was set back."""

    def __init__(self) -> None:
        self._stamps: list[float] = []
        self._poses: list[SE2] = []
        self._restarted = False

    @property
    def _newest_s(self) -> float:
        return self._stamps[-1] if self._stamps else -math.inf

    @property
    def stamps_s(self) -> NDArray[np.float64]:
        """Stamps of the poses that are kept."""
        return np.array(self._stamps)

    @property
    def poses(self) -> tuple[SE2, ...]:
        """The poses that are kept."""
        return tuple(self._poses)

    def push(self, stamp_s: float, pose: SE2) -> None:
        """Adds a pose; one that is not finite, or older than the last, is ignored."""
        if not math.isfinite(stamp_s) or not np.isfinite(pose.vector()).all():
            return
        if self._stamps:
            step_s, last = stamp_s - self._stamps[-1], self._poses[-1]
            if -SET_BACK_S < step_s <= 0.0:
                return
            jump_m = math.hypot(pose.x_m - last.x_m, pose.y_m - last.y_m)
            if step_s < 0.0 or jump_m > max(FASTEST_M_S * step_s, JUMP_M):
                self._stamps.clear()
                self._poses.clear()
                self._restarted = True
        self._stamps.append(stamp_s)
        self._poses.append(pose)
        if len(self._stamps) > 2 * KEPT:
            del self._stamps[:-KEPT], self._poses[:-KEPT]

    def at(self, stamp_s: float, tolerance_s: float = 0.0) -> SE2:
        """The pose at a stamp, interpolated, and beyond the newest one for `AHEAD_S` extrapolated. Raises
        OdometryError, also once where it restarted. tolerance_s: before the oldest one."""
        if self._restarted:
            self._restarted = False
            raise OdometryError(f"poses began again at {self._stamps[0]:.3f} s")
        if not self._stamps:
            raise OdometryError("no pose has come yet")
        first, last = self._stamps[0], self._stamps[-1]
        if not first - tolerance_s <= stamp_s <= last + AHEAD_S:
            raise OdometryError(f"no pose at {stamp_s:.3f} s: those that came are from {first:.3f} to {last:.3f} s")
        after = bisect_right(self._stamps, stamp_s)
        if after == 0 or len(self._stamps) == 1:
            return self._poses[0]
        if after < len(self._stamps):
            share = (stamp_s - self._stamps[after - 1]) / (self._stamps[after] - self._stamps[after - 1])
            return self._poses[after - 1].interpolate(self._poses[after], share)
        before = max(bisect_right(self._stamps, last - SPEED_OVER_S) - 1, 0)
        step = self._poses[before].inverse() @ self._poses[-1]
        return self._poses[-1] @ SE2(*((stamp_s - last) / (last - self._stamps[before]) * step.vector()))
