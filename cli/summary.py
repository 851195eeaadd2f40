"""The summary that `edgemap run` prints at its end."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from edgemap.geometry.camera.mount import HeightEstimate, Mount
    from edgemap.geometry.map_object import MapObject
    from edgemap.geometry.objects.evaluation_row import EvaluationRow
    from edgemap.runtime.outputs.verdict.verdict import Verdict
    from edgemap.runtime.step.slam import StepResult

SHOWN_FAULTS = 3  # kinds of them, the first ones: the rest stands in run.json and the report


class RunSummary:
    """A sink that keeps the last result and counts faults."""

    name = "summary"

    def __init__(self, mount: "Mount", mount_sources: tuple[str, str] = ("given", "given")) -> None:
        self.result: StepResult | None = None
        self.objects: list[MapObject] = []
        self.height: HeightEstimate | None = None  # of the lens, as last shown
        self.fault_count = 0
        self.faults: dict[str, str] = {}  # by kind, the first text
        self._mount, self._mount_sources = mount, mount_sources

    def write(self, result: "StepResult", objects: "list[MapObject]") -> None:
        """Stores the result."""
        self.result, self.objects = result, objects
        self.height = result.observed.height_estimate or self.height
        for text in result.observed.faults:
            self.fault(text)

    def fault(self, text: str) -> None:
        """Count it."""
        from edgemap.runtime.outputs.sinks.progress import fault_kind

        self.fault_count += 1
        self.faults.setdefault(fault_kind(text), text)

    def close(self) -> None:
        """Nothing to close."""

    def print(
        self, folder: Path, done: int, stopped: bool, verdict: "Verdict", evaluation_rows: "list[EvaluationRow]"
    ) -> None:
        """The map, the drive, how far it can be trusted, the mount as observed, the faults, and the objects."""
        from edgemap.cli.truth import object_lines
        from edgemap.geometry.camera.level import seen_text
        from edgemap.runtime.frames.reading import printable

        travelled_m = self.result.travelled_m if self.result else 0.0
        observed = self.result.observed.mount_estimate if self.result else None
        shown = observed or self.height
        lines = [
            f"map of {len(self.objects)} objects saved in {folder}/",
            f"{'stopped' if stopped else 'done'} after {done} frames, {travelled_m:.1f} m travelled",
            printable(verdict.line) + ("" if verdict.level == "good" else f"; see edgemap why {folder}/"),
            *([seen_text(self._mount, observed, self.height, self._mount_sources)] if shown else []),
            *([self.fault_line(folder)] if self.faults else []),
            *object_lines(self.objects, evaluation_rows),
        ]
        print("\n".join(lines))

    def fault_line(self, folder: Path) -> str:
        """Number of faults, and the first ones."""
        from edgemap.runtime.frames.reading import printable

        count, shown = self.fault_count, "; ".join(list(self.faults.values())[:SHOWN_FAULTS])
        rest = f"; all in {folder}/run.json" if len(self.faults) > SHOWN_FAULTS else ""
        return printable(f"{count} fault{'s' if count > 1 else ''}: {shown}{rest}")


@contextmanager
def with_map_so_far(summary: RunSummary, folder: Path) -> Iterator[None]:
    """Adds the location of the map so far to the message of an EdgemapError in the block."""
    from edgemap.geometry.errors import EdgemapError, MapError
    from edgemap.runtime.frames.errors import RunFolderError

    try:
        yield
    except EdgemapError as error:
        if summary.result is not None and not isinstance(error, (MapError, RunFolderError)):
            error.args = (f"{error}; the map so far ({len(summary.objects)} objects) is in {folder}/",)
        raise
