"""The summary that `edgemap run` prints at its end, with the evaluation of the map where the source knows the truth."""

import shlex
from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from edgemap.benchmarks.map_variants import true_object, true_objects
from edgemap.evaluation.objects import evaluation_rows
from edgemap.evaluation.rows import EvaluationRow, tally
from edgemap.geometry.camera.attitude import MountEstimate
from edgemap.geometry.camera.mount import HeightEstimate, Mount
from edgemap.geometry.errors import EdgemapError
from edgemap.geometry.map_object import MapObject
from edgemap.geometry.objects.scale import scaled_objects
from edgemap.geometry.odometry.rolling import Rolling
from edgemap.runtime.frames.camera import Camera
from edgemap.runtime.frames.faults import Fault, FaultKind
from edgemap.runtime.frames.reading import print_message, printable
from edgemap.runtime.inputs.drives import READERS, open_drive
from edgemap.runtime.inputs.open import DEMO
from edgemap.runtime.motion.height_check import HeightRule
from edgemap.runtime.motion.odometry.window import PicturesRule
from edgemap.runtime.outputs.sinks.run_folder import RunFolder
from edgemap.runtime.outputs.verdict.verdict import Verdict
from edgemap.runtime.step.sinks import Sink
from edgemap.runtime.step.slam import StepResult

SHOWN_FAULTS = 3  # kinds of them, the first ones: the rest stands in run.json and the report


class RunSummary(Sink):
    """A sink that keeps the last result and counts faults. carried: the camera has no mount whose angles could be
    compared."""

    name = "summary"

    def __init__(
        self, mount: Mount, mount_sources: tuple[str, str] = ("given", "given"), carried: bool = False
    ) -> None:
        self.result: StepResult | None = None
        self.objects: list[MapObject] = []
        self.height: HeightEstimate | None = None  # of the lens, as last shown
        self.rolling = Rolling.of_mount(PicturesRule().slip_share, mount)
        self.fault_count = 0
        self.faults: dict[FaultKind, str] = {}  # by kind, the first text
        self._mount, self._mount_sources, self._carried = mount, mount_sources, carried

    def write(self, result: StepResult, objects: list[MapObject]) -> None:
        """Stores the result."""
        self.result, self.objects = result, objects
        self.height = result.observed.height_estimate or self.height
        if result.motion.measured:
            self.rolling = self.rolling.observe(result.motion.motion, result.motion.covariance)

    def last(self, result: StepResult, objects: list[MapObject]) -> None:  # noqa: ARG002
        """Stores the map."""
        self.objects = objects

    def fault(self, fault: Fault) -> None:
        """Count it."""
        self.fault_count += 1
        self.faults.setdefault(fault.kind, fault.text)

    def print(
        self, folder: Path, done: int, stopped: bool, verdict: Verdict, evaluation_rows: list[EvaluationRow]
    ) -> None:
        """The map, the drive, how far it can be trusted, the mount as observed, the faults, and the objects."""
        scale = self.result.scale if self.result else 1.0
        travelled_m = scale * self.result.travelled_m if self.result else 0.0
        observed = self.result.observed.mount_estimate if self.result else None
        camera = self.result.observed.camera if self.result else None
        carried = self._carried or bool(camera and camera.attitude and camera.attitude.carried)
        mount = "" if carried else mount_text(self._mount, observed, self.height, self._mount_sources)
        why = shlex.quote(f"{folder}/")
        lines = [
            f"map of {len(self.objects)} object{'s' if len(self.objects) != 1 else ''} saved in {folder}/",
            f"{'stopped' if stopped else 'done'} after {done} frames, {travelled_m:.1f} m travelled",
            printable(verdict.line) + ("" if verdict.level == "good" else f"; see edgemap why {why}"),
            *([mount] if mount else []),
            *([self.fault_line(folder)] if self.faults else []),
            *object_lines(scaled_objects(self.objects, scale), evaluation_rows),
        ]
        print("\n".join(lines))

    def fault_line(self, folder: Path) -> str:
        """Number of faults, and the first ones."""
        count, shown = self.fault_count, "; ".join(list(self.faults.values())[:SHOWN_FAULTS])
        rest = f"; all in {folder}/run.json" if len(self.faults) > SHOWN_FAULTS else ""
        return printable(f"{count} fault{'s' if count > 1 else ''}: {shown}{rest}")


def mount_text(
    configured: Mount,
    estimate: MountEstimate | None,
    height: HeightEstimate | None = None,
    sources: tuple[str, str] = ("given", "given"),
) -> str:
    """One line with the configured and the estimated angles and height of a mount; empty without an estimate. One that
    could not show a wrong height is left out. sources: of the configured angles, and of the height."""
    parts = []
    if estimate is not None:
        angles = np.degrees([[mount.pitch_rad, mount.roll_rad] for mount in (configured, estimate.mount)])
        for name, before, after, sigma in zip(
            ("pitch", "roll"), *angles, np.degrees(estimate.sigma_rad[::-1]), strict=True
        ):
            parts.append(f"{name} {before:.1f} deg {sources[0]}, {after:.1f} +- {sigma:.1f} deg estimated")
    if height is not None and (sources[1] == "guessed" or height.sigma_m < HeightRule().wrong_share * height.height_m):
        estimated = f"{height.height_m:.2f} +- {height.sigma_m:.2f} m estimated"
        parts.append(f"height {configured.height_m:.2f} m {sources[1]}, {estimated}")
    return f"mount: {'; '.join(parts)}" if parts else ""


@contextmanager
def with_map_so_far(summary: RunSummary, files: RunFolder) -> Iterator[None]:
    """Adds the location of the map so far, where it is saved, to the message of an EdgemapError in the block; prints it
    where a second Ctrl-C ends the block at once."""
    try:
        yield
    except KeyboardInterrupt:
        if summary.result is not None:
            print_message(f"the map so far is in {files.folder}/")
        raise
    except EdgemapError as error:
        if summary.result is not None and files.document.get("finished"):
            error.args = (f"{error}; the map so far ({len(summary.objects)} objects) is in {files.folder}/",)
        raise


def judge_of(
    spec: str, camera: Camera, labels: Collection[str] | None
) -> Callable[[list[MapObject], int], list[EvaluationRow]] | None:
    """A function from a map and the number of frames driven to verdicts; None where the source knows no objects.

    labels: those that were to be mapped, None for all; others are not asked for.
    """
    spec = f"drive:{DEMO}" if spec == "demo" else spec
    drive = open_drive(spec) if spec.partition(":")[0] in READERS else None
    if camera.object_records() is None and (drive is None or not drive.objects or camera.info.truth is None):
        return None

    def judge(objects: list[MapObject], frames: int) -> list[EvaluationRow]:
        # What sim:SEED knows is more with every picture that it renders.
        records = camera.object_records() or []
        truth = true_objects(drive, frames) if drive else [true_object(record) for record in records]
        return evaluation_rows(objects, [item for item in truth if labels is None or item.label in labels])

    return judge


def object_lines(objects: Sequence[MapObject], evaluation_rows: Sequence[EvaluationRow]) -> list[str]:
    """The map for a terminal, one line per object, with its evaluation and the missed objects where there is truth."""
    row_of = {row.object_id: row for row in evaluation_rows if row.object_id}
    lines = []
    for item in objects:
        x_m, y_m = item.position_m
        row = row_of.get(item.id)
        state = f"  {row.state}" if row else ""
        state += f", {row.error_m:.2f} m off" if row and row.error_m is not None else ""
        seen = f"seen {item.count:4d} times  conf {item.confidence:.2f}"
        lines.append(f"  {item.id:<20} x {x_m:6.2f} m  y {y_m:6.2f} m  {seen}{state}")
    for row in evaluation_rows:
        if row.state == "missed" and row.true_m:
            lines.append(f"  {row.label:<20} x {row.true_m[0]:6.2f} m  y {row.true_m[1]:6.2f} m  {'':<26}missed")
    if evaluation_rows:
        errors = [row.error_m for row in evaluation_rows if row.state == "found" and row.error_m is not None]
        median = f"; median error {np.median(errors):.2f} m" if errors else ""
        lines.append(f"against the truth: {tally(list(evaluation_rows))}{median}")
    return lines
