"""A run's history for the report, in bounded memory: a thinned trajectory, stage times by window, detections."""

from collections import Counter, deque
from dataclasses import dataclass, field
from typing import Any

from edgemap.geometry.map_object import ellipse_95
from edgemap.runtime.frames.frame import jpeg
from edgemap.runtime.step.slam import StepResult
from edgemap.view.answers import boxes
from edgemap.view.report.crops import small

MAX_POSES = 1500
MAX_WINDOWS = 120
MAX_STILLS, STILL_PX = 40, 320  # pictures for the replay, and their longer side: half a megabyte in the report


@dataclass(slots=True)
class TimeWindow:
    """Consecutive frames. stages_ms: sums by stage. worst_ms: the slowest step."""

    end_s: float
    frames: int = 0
    worst_ms: float = 0.0
    stages_ms: Counter[str] = field(default_factory=Counter)

    def join(self, other: "TimeWindow") -> None:
        """Appends the following window."""
        self.end_s, self.frames = other.end_s, self.frames + other.frames
        self.worst_ms = max(self.worst_ms, other.worst_ms)
        self.stages_ms.update(other.stages_ms)


@dataclass(frozen=True, slots=True)
class Still:
    """A picture of the replay. boxes: as the page draws them."""

    frame: int
    stamp_s: float
    boxes: list[dict[str, Any]]
    jpeg: bytes


class History:
    """Bounded history of a run: at most `2 * MAX_POSES` poses, `2 * MAX_WINDOWS` windows and `2 * MAX_STILLS` pictures,
    whatever its length.

    last: the newest result, None before the first. detected: number of boxes by label.
    """

    def __init__(self) -> None:
        self.windows: list[TimeWindow] = []
        self.totals_ms: deque[float] = deque(maxlen=10_000)
        self.detected: Counter[str] = Counter()
        self.frames, self.start_s = 0, 0.0
        self.last: StepResult | None = None
        self._bounds: list[tuple[float, float]] = []  # stamp_s, bound_m
        self._every = self._length = self._still_every = 1
        self.stills: list[Still] = []

    def add(self, result: StepResult) -> None:
        """Adds one step."""
        stamp_s = result.frame.stamp_s
        if self.last is None:
            self.start_s = stamp_s
        if self.frames % self._every == 0:
            self._bounds.append((stamp_s, ellipse_95(result.pose_covariance)[0]))
            if len(self._bounds) >= 2 * MAX_POSES:
                self._bounds, self._every = self._bounds[::2], self._every * 2
        if self.frames % self._still_every == 0:
            image = jpeg(small(result.frame.image, STILL_PX), 60)
            self.stills.append(Still(result.frame.index, stamp_s, boxes(result), image))
            if len(self.stills) >= 2 * MAX_STILLS:
                self.stills, self._still_every = self.stills[::2], self._still_every * 2
        self.last, self.frames = result, self.frames + 1
        self.detected.update(result.detections.labels)
        self._time(stamp_s, result.stages_ms)

    def _time(self, stamp_s: float, stages_ms: dict[str, float]) -> None:
        total_ms = sum(stages_ms.values())
        self.totals_ms.append(total_ms)
        step = TimeWindow(stamp_s, 1, total_ms, Counter(stages_ms))
        if self.windows and self.windows[-1].frames < self._length:
            self.windows[-1].join(step)
            return
        self.windows.append(step)
        if len(self.windows) > 2 * MAX_WINDOWS:
            for first, second in zip(self.windows[::2], self.windows[1::2], strict=False):
                first.join(second)
            self.windows, self._length = self.windows[::2], self._length * 2

    def trail(self) -> list[tuple[float, float, float, float]]:
        """x and y in the map frame, m, stamp, s, and the radius that holds 95 % of the position by the run's own
        covariance, m: the thinned trajectory with all corrections so far. It always contains the last pose."""
        if self.last is None:
            return []
        last = (self.last.frame.stamp_s, ellipse_95(self.last.pose_covariance)[0])
        bounds = self._bounds if self._bounds[-1] == last else [*self._bounds, last]
        poses = self.poses([stamp_s for stamp_s, _ in bounds])
        return [
            (x_m, y_m, stamp_s, self.last.scale * bound_m)
            for (x_m, y_m, _), (stamp_s, bound_m) in zip(poses, bounds, strict=True)
        ]

    def poses(self, stamps_s: list[float]) -> list[list[float]]:
        """x, y and yaw in the map frame at these stamps, with all corrections so far; none before the first step."""
        if self.last is None:
            return []
        rows, scale = self.last.trajectory.at(stamps_s).tolist(), self.last.scale
        return [[scale * x_m, scale * y_m, yaw_rad] for x_m, y_m, yaw_rad in rows]
