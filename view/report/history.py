"""A run's history for the report, in bounded memory: a subsampled trajectory, times and detections by window."""

from collections import Counter, deque
from dataclasses import dataclass, field

from edgemap.geometry.map_object import ellipse_95
from edgemap.geometry.se2 import SE2
from edgemap.runtime.step.pose_journal import PoseJournal
from edgemap.runtime.step.slam import StepResult

MAX_POSES = 4000
MAX_WINDOWS = 240


@dataclass(slots=True)
class TimeWindow:
    """Consecutive frames. stages_ms: sums by stage. worst_ms: the slowest step. seen: number of detections by label."""

    start_s: float
    end_s: float
    frames: int = 0
    worst_ms: float = 0.0
    stages_ms: Counter[str] = field(default_factory=Counter)
    seen: Counter[str] = field(default_factory=Counter)

    def join(self, other: "TimeWindow") -> None:
        """Appends the following window."""
        self.end_s, self.frames = other.end_s, self.frames + other.frames
        self.worst_ms = max(self.worst_ms, other.worst_ms)
        self.stages_ms.update(other.stages_ms)
        self.seen.update(other.seen)


@dataclass(frozen=True, slots=True)
class PoseSample:
    """One pose of the trajectory. bound_m: radius that holds 95 % of its position by the pipeline's own covariance."""

    stamp_s: float
    pose_map_base: SE2
    bound_m: float


class History:
    """Bounded history of a run: at most `2 * MAX_POSES` poses and `2 * MAX_WINDOWS` windows, whatever its length."""

    def __init__(self) -> None:
        self.windows: list[TimeWindow] = []
        self.totals_ms: deque[float] = deque(maxlen=10_000)
        self.frames, self.path_m = 0, 0.0
        self.start_s = self.last_s = 0.0
        self._bounds: list[tuple[float, float]] = []  # stamp_s, bound_m
        self._last_bound_m = 0.0
        self._every = self._length = 1
        self._journal: PoseJournal | None = None

    def add(self, result: StepResult) -> None:
        """Adds one step."""
        self.last_s, self._last_bound_m = result.frame.stamp_s, ellipse_95(result.pose_covariance)[0]
        if self.frames == 0:
            self.start_s = self.last_s
        self._journal, self.path_m = result.trajectory, result.travelled_m
        if self.frames % self._every == 0:
            self._bounds.append((self.last_s, self._last_bound_m))
            if len(self._bounds) >= 2 * MAX_POSES:
                self._bounds, self._every = self._bounds[::2], self._every * 2
        self.frames += 1
        self._time(result)

    def _time(self, result: StepResult) -> None:
        total_ms = sum(result.stages_ms.values())
        self.totals_ms.append(total_ms)
        stamp_s = result.frame.stamp_s
        seen = Counter(result.detections.labels)
        step = TimeWindow(stamp_s, stamp_s, 1, total_ms, Counter(result.stages_ms), seen)
        if self.windows and self.windows[-1].frames < self._length:
            self.windows[-1].join(step)
            return
        self.windows.append(step)
        if len(self.windows) > 2 * MAX_WINDOWS:
            for first, second in zip(self.windows[::2], self.windows[1::2], strict=False):
                first.join(second)
            self.windows, self._length = self.windows[::2], self._length * 2

    def trajectory(self) -> list[PoseSample]:
        """The thinned trajectory with all corrections so far; it always contains the last pose."""
        if self._journal is None:
            return []
        bounds, last = self._bounds, (self.last_s, self._last_bound_m)
        bounds = bounds if bounds[-1] == last else [*bounds, last]
        poses = self._journal.at([stamp_s for stamp_s, _ in bounds])
        return [PoseSample(stamp_s, SE2(*pose), bound) for (stamp_s, bound), pose in zip(bounds, poses, strict=True)]
