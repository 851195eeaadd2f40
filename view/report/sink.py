"""The sink that collects the report's data and writes `report.html` when the run ends."""

import json
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

from edgemap.evaluation.rows import EvaluationRow
from edgemap.geometry.map_object import MapObject
from edgemap.geometry.objects.annotations import Annotations
from edgemap.runtime.frames.disk import write_atomically
from edgemap.runtime.frames.errors import CameraError, DiskError
from edgemap.runtime.frames.frame import jpeg
from edgemap.runtime.frames.trajectory import Trajectory
from edgemap.runtime.inputs.drives.pictures import read_picture
from edgemap.runtime.step.grid_file import load_grid
from edgemap.runtime.step.map_file import load_annotated_map
from edgemap.runtime.step.sinks import Sink
from edgemap.runtime.step.slam import StepResult
from edgemap.view.report.crops import BestCrops, small
from edgemap.view.report.document import ReportContent, report_document
from edgemap.view.report.history import History
from edgemap.view.report.page import report_page

_TIDY_EVERY = 50  # frames between two looks at which pictures are still wanted
_MOUNT_PX = 640  # longer side

Judge = Callable[[list[MapObject], int], list[EvaluationRow]]


class ReportFile(Sink):
    """Writes `report.html` into a run folder. It must come AFTER the folder's own sink, whose files the page shows.

    about: of `about_run`. truth: the drive's poses from its start, None where unknown. judge: function from the map and
    the number of frames to evaluation rows; None without truth. crops: collects the pictures, also for other readers. A
    report that fails never ends the run: `failure` gives the reason in one line, and `evaluation_rows` are there either
    way.
    """

    name = "report"

    def __init__(
        self,
        folder: Path,
        about: dict[str, Any],
        truth: Trajectory | None = None,
        judge: Judge | None = None,
        crops: BestCrops | None = None,
    ) -> None:
        self.path = folder / "report.html"
        self.failure = ""
        self.evaluation_rows: list[EvaluationRow] = []
        self._folder, self._about, self._truth, self._judge = folder, about, truth, judge
        self._crops, self._history = BestCrops() if crops is None else crops, History()
        self._closed = False

    def write(self, result: StepResult, objects: list[MapObject]) -> None:
        """Adds one step."""
        self._history.add(result)
        self._crops.consider(result)
        if self._history.frames % _TIDY_EVERY == 0:
            self._crops.keep({item.id for item in objects}, result.merged)

    def last(self, result: StepResult, objects: list[MapObject]) -> None:  # noqa: ARG002
        """Adds the last boxes."""
        self._crops.consider(result)

    def close(self) -> None:
        """Write the page; never raises."""
        if self._closed:
            return
        self._closed = True
        self._write()

    def edited(self, objects: list[MapObject], annotations: Annotations) -> None:  # noqa: ARG002
        """The map was edited, and the run folder has saved it: after the run's end the page is written again."""
        if self._closed:
            self._write()

    def _write(self) -> None:
        try:
            write_atomically(self.path, report_page(report_document(self._content())))
        except DiskError as error:
            self.failure = str(error)
        except Exception as error:  # the map is saved, and the run's end goes on
            self.failure = f"{self.path} was not written ({type(error).__name__}: {error})"

    def _content(self) -> ReportContent:
        objects, annotations = load_annotated_map(self._folder)
        record = json.loads((self._folder / "run.json").read_text())
        if self._judge:
            self.evaluation_rows = self._judge(objects, self._history.frames)
        self._crops.keep({item.id for item in objects}, record.get("merged", {}))
        crops = self._crops.of([item.id for item in objects])
        return ReportContent(
            self._about, record, objects, self._history, crops, self._truth, self.evaluation_rows, self._mount(),
            annotations, load_grid(self._folder),
        )  # fmt: skip

    def _mount(self) -> bytes | None:
        """mount.jpg, small."""
        with suppress(CameraError):
            return jpeg(small(read_picture(self._folder / "mount.jpg"), _MOUNT_PX), 72)
        return None
