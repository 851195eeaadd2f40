"""What a report keeps of a run, in bounded memory: the way thinned out, times and detections summed over stretches."""

from __future__ import annotations

from collections import Counter, deque
from dataclasses import dataclass, field, replace

import numpy as np

from edgemap.geometry.objects.map_object import CHI2_95
from edgemap.geometry.se2 import SE2
from edgemap.geometry.slam.keyframes import TrajectoryCorrection
from edgemap.runtime.pipeline import StepResult

MOST_POSES = 4000
MOST_STRETCHES = 240


@dataclass(slots=True)
class Window:
    """Some frames in a row. stages_ms: sums by stage. worst_ms: the slowest step. seen: detections by label."""

    start_s: float
    end_s: float
    frames: int = 0
    worst_ms: float = 0.0
    stages_ms: Counter[str] = field(default_factory=Counter)
    seen: Counter[str] = field(default_factory=Counter)

    def join(self, other: Window) -> None:
        """Take in the stretch that follows."""
        self.end_s, self.frames = other.end_s, self.frames + other.frames
        self.worst_ms = max(self.worst_ms, other.worst_ms)
        self.stages_ms.update(other.stages_ms)
        self.seen.update(other.seen)


@dataclass(frozen=True, slots=True)
class PoseSample:
    """One pose on the way. bound_m: radius that holds 95 % of its position by the pipeline's own covariance."""

    stamp_s: float
    pose_map_base: SE2
    bound_m: float


class History:
    """Fed every step; at most `2 * MOST_POSES` poses and `2 * MOST_STRETCHES` stretches, however long it goes on."""

    def __init__(self) -> None:
        self.stops: list[PoseSample] = []
        self.stretches: list[Window] = []
        self.totals_ms: deque[float] = deque(maxlen=10_000)
        self.frames, self.way_m = 0, 0.0
        self.last: PoseSample | None = None
        self.start_s = 0.0
        self._every = self._length = 1
        self._past: TrajectoryCorrection | None = None  # how the stops moved since they were taken

    def add(self, result: StepResult) -> None:
        """Take in one step."""
        stamp_s, pose = result.frame.stamp_s, result.pose_map_base
        if self.last is None:
            self.start_s = stamp_s
        else:
            before = self.last.pose_map_base
            if result.corrected is not None:
                past = result.corrected.past
                before = result.corrected.moved(self.last.stamp_s, before)
                self._past = past if self._past is None else self._past.then(past)
            if result.relocated is not None:  # from here on in a saved map's frame: the way so far is told in it too
                self._settle_past()
                self.stops = [replace(stop, pose_map_base=result.relocated @ stop.pose_map_base) for stop in self.stops]
            else:
                self.way_m += float(np.hypot(pose.x_m - before.x_m, pose.y_m - before.y_m))
        self.last = PoseSample(stamp_s, pose, _bound_m(result.pose_covariance))
        if self.frames % self._every == 0:
            self.stops.append(self.last)
            if len(self.stops) >= 2 * MOST_POSES:
                self.stops, self._every = self.stops[::2], self._every * 2
        self.frames += 1
        self._time(result)

    def _settle_past(self) -> None:
        """Move the stops to where they are known to be by now;"""
        past, self._past = self._past, None
        if past is None or not self.stops:
            return
        poses = past.poses([stop.stamp_s for stop in self.stops], [stop.pose_map_base.vector() for stop in self.stops])
        moved = [replace(stop, pose_map_base=SE2(*pose)) for stop, pose in zip(self.stops, poses, strict=True)]
        if self.stops[-1] is self.last:
            self.last = moved[-1]
        self.stops = moved

    def _time(self, result: StepResult) -> None:
        total_ms = sum(result.stages_ms.values())
        self.totals_ms.append(total_ms)
        stamp_s = result.frame.stamp_s
        seen = Counter(result.detections.labels)
        step = Window(stamp_s, stamp_s, 1, total_ms, Counter(result.stages_ms), seen)
        if self.stretches and self.stretches[-1].frames < self._length:
            self.stretches[-1].join(step)
            return
        self.stretches.append(step)
        if len(self.stretches) > 2 * MOST_STRETCHES:
            for first, second in zip(self.stretches[::2], self.stretches[1::2], strict=False):
                first.join(second)
            self.stretches, self._length = self.stretches[::2], self._length * 2

    def way(self) -> list[PoseSample]:
        """The thinned way as it is known now, the last pose always in it."""
        self._settle_past()
        if self.last is not None and self.stops[-1] is not self.last:
            return [*self.stops, self.last]
        return self.stops


def _bound_m(covariance: np.ndarray) -> float:
    """The longer half axis of the position's 95 % ellipse."""
    (a, b), (_, c) = covariance[0, :2], covariance[1, :2]
    largest = (a + c) / 2.0 + np.hypot((a - c) / 2.0, b)
    return float(np.sqrt(CHI2_95 * max(largest, 0.0)))
