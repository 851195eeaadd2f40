"""Progress of a run on standard error: a progress bar on a terminal, plain lines elsewhere."""

import re
import sys
from time import monotonic

from tqdm import tqdm

from edgemap.geometry.map_object import MapObject
from edgemap.runtime.frames.reading import print_message, printable
from edgemap.runtime.step.sinks import Sink
from edgemap.runtime.step.slam import StepResult

LINE_EVERY_S = 10.0  # where there is no terminal: often enough to see that it runs, rare enough for a journal


class ProgressBar(Sink):
    """Frames done, speed, objects and faults on a terminal. total: None for live cameras."""

    name = "progress bar"
    for_caller = True

    def __init__(self, total: int | None) -> None:
        self._bar = tqdm(total=total, unit=" frames", file=sys.stderr, leave=False)
        self._shown: str | None = None

    def write(self, result: StepResult, objects: list[MapObject]) -> None:
        """Move on by one frame."""
        for text in result.observed.faults:
            self.fault(text)
        self._bar.set_postfix_str(_state(result, objects), refresh=False)
        self._bar.update()

    def fault(self, text: str) -> None:
        """Print it above the bar, unless it repeats the one printed last."""
        if fault_kind(text) != self._shown:
            self._shown = fault_kind(text)
            self._bar.write(printable(text), file=sys.stderr)

    def close(self) -> None:
        """End the line."""
        self._bar.close()


class ProgressLines(Sink):
    """Progress in a log: a line every 10 s, and each fault, unless it differs from an earlier one in its numbers only.

    total: None for live cameras.
    """

    name = "progress lines"
    for_caller = True

    def __init__(self, total: int | None) -> None:
        self._total = total
        self._frames = self._repeated = 0
        self._printed: set[str] = set()
        self._line_s = monotonic()

    def write(self, result: StepResult, objects: list[MapObject]) -> None:
        """One frame more; print the line when it is due."""
        self._frames += 1
        for text in result.observed.faults:
            self.fault(text)
        if monotonic() - self._line_s >= LINE_EVERY_S:
            self._line_s = monotonic()
            of = f" of {self._total}" if self._total else ""
            again = f", {self._repeated} more faults like those above" if self._repeated else ""
            print_message(f"{self._frames}{of} frames, {_state(result, objects)}{again}")
            self._printed.clear()
            self._repeated = 0

    def fault(self, text: str) -> None:
        """Print it, unless it was since the last line."""
        kind = fault_kind(text)
        if kind in self._printed:
            self._repeated += 1
            return
        self._printed.add(kind)
        print_message(f"frame {self._frames}: {text}")


def fault_kind(text: str) -> str:
    """A fault without its numbers: the same for one that repeats with others."""
    return re.sub(r"[-+]?\d+(\.\d+)?", "#", text)


def progress(total: int | None) -> Sink:
    """The bar where standard error is a terminal, else the lines."""
    terminal = sys.stderr is not None and sys.stderr.isatty()
    return ProgressBar(total) if terminal else ProgressLines(total)


def _state(result: StepResult, objects: list[MapObject]) -> str:
    pose = result.pose_map_base
    return f"{len(objects)} objects, at x {pose.x_m:.2f} m y {pose.y_m:.2f} m"
