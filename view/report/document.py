"""All data of a report as one JSON document: what the live page gets over its socket, and what a run leaves."""

from base64 import b64encode
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, field, replace
from typing import Any

import numpy as np

from edgemap.evaluation.rows import EvaluationRow, tally
from edgemap.geometry.grid.occupancy_grid import OccupancyGrid
from edgemap.geometry.map_object import MapObject
from edgemap.geometry.objects.annotations import NO_ANNOTATIONS, Annotations
from edgemap.runtime.frames.colours import label_mark
from edgemap.runtime.frames.errors import OdometryError
from edgemap.runtime.frames.faults import Fault, read_fault
from edgemap.runtime.frames.timing import percentiles
from edgemap.runtime.frames.trajectory import Trajectory
from edgemap.runtime.outputs.verdict.causes import CAUSE_OF
from edgemap.runtime.outputs.verdict.verdict import TITLES, Verdict, verdict_or_none
from edgemap.view.answers import floor_answer, map_object_answer, rooms_answer, zones_answer
from edgemap.view.report.crops import Crop
from edgemap.view.report.history import History
from edgemap.view.status import LEVELS, pose_sigma

MAXIMUM_OBJECTS = 1000  # those observed most often
MAXIMUM_FAULTS = 60
DEMO_NOTE = "a minute in a rendered home (synthetic); close to a plain wall some pictures show nothing"
_NO_SETTINGS = {"stages_ms", "faults", "verdict", "fault_count", "merged", "format", "finished", "frames", "seconds"}


@dataclass(frozen=True, slots=True)
class ReportContent:
    """All contents of a report. about: of `about_run`. record: what run.json holds. truth: of the base from its start,
    None where unknown. rows: the evaluation, empty without truth. mount_jpeg: the first picture with horizon and grid.
    """

    about: dict[str, Any]
    record: Mapping[str, Any]
    objects: Sequence[MapObject]
    history: History
    crops: Mapping[str, Crop] = field(default_factory=dict)
    truth: Trajectory | None = None
    rows: list[EvaluationRow] = field(default_factory=list)
    mount_jpeg: bytes | None = None
    annotations: Annotations = NO_ANNOTATIONS
    grid: OccupancyGrid | None = None


def report_document(content: ReportContent) -> dict[str, Any]:
    """about, update: the page's two messages. pictures: by object. run: what only a report shows."""
    objects = sorted(content.objects, key=lambda item: -item.count)[:MAXIMUM_OBJECTS]
    labels = {item.label for item in objects} | {row.label for row in content.rows}
    marks = {label: asdict(label_mark(label)) for label in labels}
    trail, verdict = content.history.trail(), verdict_or_none(content.record, list(content.objects))
    findings = verdict.findings if verdict else ()
    reasons = [{"text": finding.text, "remedy": finding.cause.remedy} for finding in findings]
    return {
        "about": content.about | {"live": False, "marks": content.about["marks"] | marks},
        "update": _update(content, objects, trail, verdict),
        "pictures": {name: data_uri(crop.jpeg) for name, crop in content.crops.items()},
        "run": _figures(content)
        | _times(content)
        | {
            "verdict": verdict and {"level": verdict.level, "title": TITLES[verdict.level], "reasons": reasons},
            "replay": _replay(content.history),
            "truth": _truth(content, trail),
            "mount": data_uri(content.mount_jpeg) if content.mount_jpeg else "",
            "settings": {key: value for key, value in content.record.items() if key not in _NO_SETTINGS},
        },
    }


def _update(
    content: ReportContent, objects: Sequence[MapObject], trail: list[tuple[float, ...]], verdict: Verdict | None
) -> dict[str, Any]:
    """The one update that shows the finished run."""
    headline = verdict.line.capitalize() if verdict else "The map that the run saved"
    dock, last = content.annotations.dock, content.history.last
    update: dict[str, Any] = {
        "number": 0, "state": "finished", "moved": False, "events": [], "gone": [], "boxes": [],
        "status": {"level": LEVELS[verdict.level] if verdict else "ok", "headline": f"{headline}.", "problems": []}
        | {"verdict": verdict.document() if verdict else None},
        "faults": [_fault(read_fault(entry)) for entry in content.record.get("faults", [])[:MAXIMUM_FAULTS]],
        "fault_count": content.record.get("fault_count", 0),
        "trail": [[round(value, 3) for value in sample] for sample in trail],
        "changed": [map_object_answer(item) for item in objects],
        "zones": zones_answer(content.annotations.zones, objects),
        "dock": dock and list(dock.vector()),
    }  # fmt: skip
    if content.grid is not None:
        update |= {"floor": floor_answer(content.grid)}
        update |= rooms_answer(content.objects, content.annotations, content.grid)
    if last is not None:
        units = np.array([last.scale, last.scale, 1.0])  # the map is saved at this scale
        last = replace(
            last, pose_map_base=last.pose_map_base.scaled(last.scale),
            pose_covariance=last.pose_covariance * np.outer(units, units),
        )  # fmt: skip
        update |= {
            "stamp_s": last.frame.stamp_s,
            "pose": list(last.pose_map_base.vector()),
            "pose_sigma": pose_sigma(last),
            "pose_covariance": last.pose_covariance.tolist(),
        }
    return update


def _fault(fault: Fault) -> dict[str, str]:
    """A fault with its frame, and its remedy where there is one."""
    cause = CAUSE_OF.get(fault.kind)
    return {"kind": fault.kind, "text": fault.line, "remedy": cause.remedy if cause else ""}


def _replay(history: History) -> list[dict[str, Any]]:
    """The pictures of the drive with their boxes, the time since its start and the robot's pose."""
    poses = history.poses([still.stamp_s for still in history.stills])
    return [
        {
            "frame": still.frame,
            "time_s": round(still.stamp_s - history.start_s, 2),
            "pose": [round(value, 3) for value in pose],
            "boxes": still.boxes,
            "jpeg": data_uri(still.jpeg),
        }
        for still, pose in zip(history.stills, poses, strict=True)
    ]


def _figures(content: ReportContent) -> dict[str, Any]:
    """The run in numbers."""
    record, history = content.record, content.history
    last, seconds = history.last, record.get("seconds", 0.0)
    frames, mapped = record.get("frames", history.frames), record.get("mapped", [])
    return {
        "started": str(record.get("started_utc", "")).replace("T", " ").replace("+00:00", " UTC"),
        "clustering": record.get("clustering", ""),
        "source": [*record.get("source", []), *([DEMO_NOTE] if content.about["camera"] == "demo" else [])],
        "objects": len(content.objects),
        "frames": frames,
        "rate_hz": frames / seconds if seconds else None,
        "start_s": history.start_s,
        "span_s": last.frame.stamp_s - history.start_s if last else 0.0,
        "path_m": last.scale * last.travelled_m if last else 0.0,
        "detected": [[label, count, label in mapped] for label, count in history.detected.most_common()],
    }


def _times(content: ReportContent) -> dict[str, Any]:
    """Percentiles of stages and of the complete step, and mean times by window: its end, s, the slowest step, ms, and
    the mean of each stage, ms."""
    history, stages = content.history, dict(content.record.get("stages_ms", {}))
    windows = [
        [round(one.end_s - history.start_s, 2), round(one.worst_ms, 2)]
        + [round(one.stages_ms[name] / one.frames, 3) for name in stages]
        for one in history.windows
    ]
    total = percentiles(list(history.totals_ms)) if history.totals_ms else {}
    return {"stages": stages, "step_ms": total, "windows": windows}


def _truth(content: ReportContent, trail: list[tuple[float, ...]]) -> dict[str, Any] | None:
    """The true trajectory and the position errors along it, empty unless the truth covers all of it; the evaluation of
    the objects. None without truth."""
    rows, path = content.rows, list[tuple[float, float]]()
    if content.truth:
        with suppress(OdometryError):
            poses = [content.truth.at(stamp_s) for _, _, stamp_s, _ in trail]
            path = [(round(pose.x_m, 3), round(pose.y_m, 3)) for pose in poses]
    if not path and not rows:
        return None
    errors = [float(np.hypot(x - tx, y - ty)) for (x, y, *_), (tx, ty) in zip(trail, path, strict=False)]
    matched = [row.error_m for row in rows if row.state == "found" and row.error_m is not None]
    return {
        "path": path,
        "errors_m": [round(error, 3) for error in errors],
        "rows": [asdict(row) for row in rows],
        "tally": tally(rows) if rows else "",
        "median_error_m": float(np.median(matched)) if matched else None,
    }


def data_uri(jpeg: bytes) -> str:
    """A JPEG file as an address that needs no request."""
    return "data:image/jpeg;base64," + b64encode(jpeg).decode()
