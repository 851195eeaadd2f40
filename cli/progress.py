"""Progress of a run on standard error: a progress bar on a terminal, plain lines elsewhere."""

import sys
from time import monotonic

from tqdm import tqdm

from edgemap.geometry.map_object import MapObject
from edgemap.runtime.frames.faults import Fault, FaultKind
from edgemap.runtime.frames.limits import SELDOM_S
from edgemap.runtime.frames.reading import print_message, printable
from edgemap.runtime.step.sinks import Sink
from edgemap.runtime.step.slam import StepResult


class Progress(Sink):
    """Frames done, objects and pose: a bar on a terminal, a line every 10 s in a log; and the first fault of each kind
    in these 10 s. total: frames of the run, None for live cameras."""

    name = "progress"
    for_caller = True

    def __init__(self, total: int | None) -> None:
        self._total = total
        terminal = sys.stderr is not None and sys.stderr.isatty()
        self._bar = tqdm(total=total, unit=" frames", file=sys.stderr, leave=False) if terminal else None
        self._frames = self._repeated = 0
        self._printed: set[FaultKind] = set()
        self._line_s = monotonic()

    def write(self, result: StepResult, objects: list[MapObject]) -> None:
        """One frame more; print the line when it is due."""
        self._frames += 1
        pose = result.pose_map_base
        state = f"{len(objects)} objects, at x {pose.x_m:.2f} m y {pose.y_m:.2f} m"
        if self._bar is not None:
            self._bar.set_postfix_str(state, refresh=False)
            self._bar.update()
        if monotonic() - self._line_s >= SELDOM_S:
            self._line_s = monotonic()
            of = f" of {self._total}" if self._total else ""
            again = f", {self._repeated} more faults like those above" if self._repeated else ""
            if self._bar is None:
                print_message(f"{self._frames}{of} frames, {state}{again}")
            self._printed.clear()
            self._repeated = 0

    def fault(self, fault: Fault) -> None:
        """Print it, above the bar, unless one of its kind was since the last line."""
        if fault.kind in self._printed:
            self._repeated += 1
            return
        self._printed.add(fault.kind)
        if self._bar is None:
            print_message(f"frame {self._frames}: {fault.text}")
        else:
            self._bar.write(printable(fault.text), file=sys.stderr)

    def close(self) -> None:
        """End the bar's line."""
        if self._bar is not None:
            self._bar.close()
