"""The true objects of a source, and the evaluation of a map against them."""

from collections.abc import Callable, Collection, Sequence
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from edgemap.evaluation.objects import TrueObject
    from edgemap.geometry.map_object import MapObject
    from edgemap.geometry.objects.evaluation_row import EvaluationRow
    from edgemap.runtime.inputs.cameras.protocol import Camera


def _shown(camera: "Camera") -> "list[TrueObject]":
    """What sim:SEED knows, which is more with every picture that it renders."""
    from edgemap.benchmarks.map_variants import true_object

    return [true_object(record) for record in camera.object_records() or []]


def judge_of(
    spec: str, camera: "Camera", labels: Collection[str] | None
) -> "Callable[[list[MapObject], int], list[EvaluationRow]] | None":
    """A function from a map and the number of frames driven to verdicts; None where the source knows no objects.

    labels: those that were to be mapped, None for all; others are not asked for.
    """
    from edgemap.benchmarks.map_variants import true_objects
    from edgemap.evaluation.objects import evaluation_rows
    from edgemap.runtime.inputs.drives import READERS, open_drive
    from edgemap.runtime.inputs.open import DEMO

    spec = f"drive:{DEMO}" if spec == "demo" else spec
    drive = open_drive(spec) if spec.partition(":")[0] in READERS else None
    if camera.object_records() is None and (drive is None or not drive.objects or camera.truth is None):
        return None

    def judge(objects: "list[MapObject]", frames: int) -> "list[EvaluationRow]":
        truth = true_objects(drive, frames) if drive else _shown(camera)
        return evaluation_rows(objects, [item for item in truth if labels is None or item.label in labels])

    return judge


def object_lines(objects: "Sequence[MapObject]", evaluation_rows: "Sequence[EvaluationRow]") -> list[str]:
    """The map for a terminal, one line per object, with its evaluation and the missed objects where there is truth."""
    import numpy as np

    from edgemap.geometry.objects.evaluation_row import tally

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
