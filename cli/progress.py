"""Progress of a run on standard error: a progress bar on a terminal, plain lines elsewhere."""

import math
import sys
from time import monotonic

from tqdm import tqdm

from edgemap.geometry.map_object import MapObject
from edgemap.runtime.frames.faults import Fault, FaultKind
from edgemap.runtime.frames.limits import SELDOM_S
from edgemap.runtime.frames.reading import print_message, printable
from edgemap.runtime.step.sinks import Sink
from edgemap.runtime.step.slam import StepResult


class ProgressBar(Sink):
    """Frames done, speed, objects and faults on a terminal. total: None for live cameras."""

    name = "progress bar"
    for_caller = True

    def __init__(self, total: int | None) -> None:
        self._bar = tqdm(total=total, unit=" frames", file=sys.stderr, leave=False)
        self._printed_s: dict[FaultKind, float] = {}

    def write(self, result: StepResult, objects: list[MapObject]) -> None:
        """Move on by one frame."""
        self._bar.set_postfix_str(_state(result, objects), refresh=False)
        self._bar.update()

    def fault(self, fault: Fault) -> None:
        """Print it above the bar, unless one of its kind was printed in the last 10 s."""
        if monotonic() - self._printed_s.get(fault.kind, -math.inf) >= SELDOM_S:
            self._printed_s[fault.kind] = monotonic()
            self._bar.write(printable(fault.text), file=sys.stderr)

    def close(self) -> None:
        """End the line."""
        self._bar.close()


class ProgressLines(Sink):
    """Progress in a log: a line every 10 s, and between two lines the first fault of each kind.

    total: None for live cameras.
    """

    name = "progress lines"
    for_caller = True

    def __init__(self, total: int | None) -> None:
        self._total = total
        self._frames = self._repeated = 0
        self._printed: set[FaultKind] = set()
        self._line_s = monotonic()

    def write(self, result: StepResult, objects: list[MapObject]) -> None:
        """One frame more; print the line when it is due."""
        self._frames += 1
        if monotonic() - self._line_s >= SELDOM_S:
            self._line_s = monotonic()
            of = f" of {self._total}" if self._total else ""
            again = f", {self._repeated} more faults like those above" if self._repeated else ""
            print_message(f"{self._frames}{of} frames, {_state(result, objects)}{again}")
            self._printed.clear()
            self._repeated = 0

    def fault(self, fault: Fault) -> None:
        """Print it, unless one of its kind was since the last line."""
        if fault.kind in self._printed:
            self._repeated += 1
            return
        self._printed.add(fault.kind)
        print_message(f"frame {self._frames}: {fault.text}")


def progress(total: int | None) -> Sink:
    """The bar where standard error is a terminal, else the lines."""
    terminal = sys.stderr is not None and sys.stderr.isatty()
    return ProgressBar(total) if terminal else ProgressLines(total)


def _state(result: StepResult, objects: list[MapObject]) -> str:
    pose = result.pose_map_base
    return f"{len(objects)} objects, at x {pose.x_m:.2f} m y {pose.y_m:.2f} m"
