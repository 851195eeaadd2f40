"""Planar poses that arrive one by one, looked up as a recorded trajectory is."""

from __future__ import annotations

import math
from bisect import bisect_right

import numpy as np
from numpy.typing import NDArray

from edgemap.geometry.se2 import SE2
from edgemap.runtime.errors import OdometryError

KEPT = 500
AHEAD_S = 0.2  # beyond the newest pose, at the speed of the last two


class GrowingTrack:
    """The newest poses, by stamps that only go forward. A pose that is older than the newest one begins anew: a clock
    that was set back."""

    def __init__(self) -> None:
        self._stamps: list[float] = []
        self._poses: list[SE2] = []

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
        """Take in a pose; one that is not finite, or of the same stamp, is left out."""
        if not math.isfinite(stamp_s) or not np.isfinite(pose.vector()).all():
            return
        if self._stamps and stamp_s == self._stamps[-1]:
            return
        if self._stamps and stamp_s < self._stamps[-1]:
            self._stamps.clear()
            self._poses.clear()
        self._stamps.append(stamp_s)
        self._poses.append(pose)
        if len(self._stamps) > 2 * KEPT:
            del self._stamps[:-KEPT], self._poses[:-KEPT]

    def at(self, stamp_s: float, tolerance_s: float = 0.0) -> SE2:
        """The pose at a stamp, interpolated, and beyond the newest one for `AHEAD_S` extrapolated. Raises
        OdometryError. tolerance_s: before the oldest one."""
        if not self._stamps:
            raise OdometryError("no pose has come yet")
        first, last = self._stamps[0], self._stamps[-1]
        if not first - tolerance_s <= stamp_s <= last + AHEAD_S:
            raise OdometryError(f"no pose at {stamp_s:.3f} s: those that came are from {first:.3f} to {last:.3f} s")
        after = bisect_right(self._stamps, stamp_s)
        if after == 0 or len(self._stamps) == 1:
            return self._poses[0]
        after = min(after, len(self._stamps) - 1)
        before_s, before, now = self._stamps[after - 1], self._poses[after - 1], self._poses[after]
        share = (stamp_s - before_s) / (self._stamps[after] - before_s)
        if share <= 1.0:
            return before.interpolate(now, share)
        step = before.inverse() @ now
        return now @ SE2(*((share - 1.0) * step.vector()))
