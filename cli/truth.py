"""What is known of the objects where a camera drives, and what that says of a map."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from edgemap.evaluation.objects import TrueObject
    from edgemap.geometry.floor_map import MapObject
    from edgemap.geometry.verdict import Verdict
    from edgemap.runtime.cameras.protocol import Camera
    from edgemap.runtime.drives import Drive

DRIVES_WITH_OBJECTS = ("drive",)


def true_objects(drive: Drive, frames: int | None = None) -> list[TrueObject]:
    """The drive's objects, each with the number of frames in which it was seen: in boxes.json where that is known."""
    from collections import Counter

    from edgemap.evaluation.objects import TrueObject

    seen: Counter[str] = Counter()
    for boxes in drive.boxes[:frames]:
        seen.update(boxes.seen_ids())
    return [
        TrueObject(
            item["label"],
            item["x_m"],
            item["y_m"],
            item["on_floor"],
            seen[str(item["id"])] if drive.boxes else int(item.get("visible_frames") or 0),
            tuple((float(x_m), float(y_m)) for x_m, y_m in item.get("footprint_m") or ()),
        )
        for item in drive.objects
    ]


def judge_of(
    spec: str, camera: Camera, labels: Collection[str] | None
) -> Callable[[list[MapObject], int], list[Verdict]] | None:
    """A function from a map and the number of frames driven to verdicts; None where the source knows no objects.

    labels: those that were to be mapped, None for all; others are not asked for.
    """
    from edgemap.evaluation.verdicts import verdicts
    from edgemap.runtime.cameras.open import DEMO
    from edgemap.runtime.drives import open_drive

    spec = f"drive:{DEMO}" if spec == "demo" else spec
    if camera.truth is None or spec.partition(":")[0] not in DRIVES_WITH_OBJECTS:
        return None
    drive = open_drive(spec)
    if not drive.objects:
        return None

    def judge(objects: list[MapObject], frames: int) -> list[Verdict]:
        truth = [item for item in true_objects(drive, frames) if labels is None or item.label in labels]
        return verdicts(objects, truth)

    return judge


def verdict_lines(rows: Sequence[Verdict]) -> list[str]:
    """The table of verdicts for a terminal: found ones by their error only, then what is wrong, one a line."""
    from edgemap.geometry.verdict import tally

    lines = [f"against the truth: {tally(list(rows))}"]
    for row in rows:
        where = "" if row.true_m is None else f"  true x {row.true_m[0]:6.2f} m  y {row.true_m[1]:6.2f} m"
        error = "" if row.error_m is None else f"  {row.error_m:.2f} m off"
        lines.append(f"  {row.state:<10} {row.object_id or row.label:<20}{where}{error}")
    return lines
