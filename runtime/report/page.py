"""Puts the report together: one HTML file that asks for nothing else."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from edgemap.geometry.objects.edits import Zone
from edgemap.geometry.objects.evaluation_row import EvaluationRow, tally
from edgemap.geometry.objects.map_object import MapObject
from edgemap.geometry.se2 import SE2
from edgemap.runtime.errors import OdometryError
from edgemap.runtime.report import charts, tables
from edgemap.runtime.report.crops import Crop
from edgemap.runtime.report.floor_svg import floor_svg
from edgemap.runtime.report.history import History, PoseSample
from edgemap.runtime.report.markup import Markup, data_uri, el, joined
from edgemap.runtime.timing import percentiles
from edgemap.runtime.trajectory import Trajectory

# The browser itself refuses whatever the page might ask for.
_POLICY = "default-src 'none'; img-src data:; style-src 'unsafe-inline'"


@dataclass(frozen=True, slots=True)
class Findings:
    """All contents of a report. record: what run.json holds. truth: of the base from its start, None where unknown.
    evaluation_rows: empty where no truth is known. mount_jpeg: the first picture with horizon and metre grid."""

    record: dict[str, Any]
    objects: list[MapObject]
    history: History
    crops: dict[str, Crop] = field(default_factory=dict)
    truth: Trajectory | None = None
    evaluation_rows: list[EvaluationRow] | None = None
    mount_jpeg: bytes | None = None
    zones: tuple[Zone, ...] = ()


def report_page(found: Findings) -> str:
    """The whole page as text."""
    trajectory, true_trajectory = found.history.trajectory(), _true_trajectory(found)
    errors_m = _errors(trajectory, true_trajectory)
    title = f"{len(found.objects)} objects on the map"
    style = Markup(Path(__file__).with_name("report.css").read_text())
    head = el(
        "head",
        el("meta", charset="utf-8"),
        el("meta", name="viewport", content="width=device-width, initial-scale=1"),
        el("meta", http_equiv="Content-Security-Policy", content=_POLICY),
        el("meta", name="color-scheme", content="light dark"),
        el("title", f"edgemap: {title}"),
        el("style", style),
    )
    sections = [
        _masthead(found, title),
        _tiles(found, errors_m),
        _floor(found, trajectory, true_trajectory),
        _objects(found),
        _trajectory(trajectory, errors_m),
        _timeline(found),
        _latency(found),
        _mount(found),
        _section("Faults", tables.fault_list(found.record), name="wide"),
        _folded("Configuration", tables.settings_table(found.record)),
        el(
            "footer", "Written by edgemap run. Positions in the map frame: origin at the first pose, x forward, y left."
        ),
    ]
    page = el("html", head, el("body", el("main", sections)), lang="en")
    return f"<!doctype html>\n{page}\n"


def _true_trajectory(found: Findings) -> list[SE2 | None]:
    """The true pose at each stop, None where it is not known."""
    poses: list[SE2 | None] = []
    for sample in found.history.trajectory():
        try:
            poses.append(found.truth.at(sample.stamp_s) if found.truth else None)
        except OdometryError:
            poses.append(None)
    return poses


def _errors(trajectory: Sequence[PoseSample], true_trajectory: Sequence[SE2 | None]) -> list[float]:
    """Position errors in metres; empty unless the truth is known all the way."""
    found = []
    for sample, true in zip(trajectory, true_trajectory, strict=True):
        if true is None:
            return []
        found.append(float(np.hypot(sample.pose_map_base.x_m - true.x_m, sample.pose_map_base.y_m - true.y_m)))
    return found


def _masthead(found: Findings, title: str) -> Markup:
    record = found.record
    words = [
        f"camera {record.get('camera', '?')}",
        f"{record.get('bundle', {}).get('name', '?')}",
        f"{record.get('odometry', '?')} odometry",
        f"{record.get('clustering', '?')} clustering",
        str(record.get("started_utc", "")).replace("T", " ").replace("+00:00", " UTC"),
    ]
    faults = record.get("fault_count", 0)
    state = f"{faults} fault{'s' * (faults != 1)}" if faults else "no faults"
    badge = el("span", state, class_="pill missed" if faults else "pill found")
    return el(
        "header",
        el("p", "edgemap run", class_="over"),
        el("h1", title),
        el("p", " · ".join(filter(None, words)), " ", badge),
    )


def _tiles(found: Findings, errors_m: list[float]) -> Markup:
    record, history = found.record, found.history
    span_s = history.last_s - history.start_s
    frames, seconds = record.get("frames", history.frames), record.get("seconds", 0.0)
    tiles = [
        ("objects", f"{len(found.objects)}"),
        ("path", f"{history.path_m:.1f} m"),
        ("drive", charts.duration(round(span_s, 1))),
    ]
    tiles += [("frames", f"{frames}"), ("frames/s", f"{frames / seconds:.0f}" if seconds else "–")]
    if history.totals_ms:
        tiles.append(("step, p95", f"{percentiles(list(history.totals_ms))['p95']:.1f} ms"))
    if found.evaluation_rows:
        wanted = [row for row in found.evaluation_rows if row.state in ("found", "misplaced", "missed")]
        tiles.append(("found", f"{sum(row.state == 'found' for row in wanted)} of {len(wanted)}"))
    if errors_m:
        tiles.append(("off at the end", f"{errors_m[-1]:.2f} m"))
    return el("dl", [el("div", el("dt", name), el("dd", value)) for name, value in tiles], class_="tiles")


def _floor(found: Findings, trajectory: list[PoseSample], true_trajectory: list[SE2 | None]) -> Markup:
    labels = sorted(
        {item.label for item in found.objects} | {row.label for row in found.evaluation_rows or [] if row.true_m}
    )
    legend = [el("li", tables.swatch(label), label) for label in labels]
    keys = [
        el("li", el("i", class_="key disc"), "floor it takes, as a circle"),
        el("li", el("i", class_="key ellipse"), "95 % ellipse"),
        el("li", el("i", class_="key trajectory"), "trajectory"),
        el("li", el("i", class_="key start"), "start"),
        el("li", el("i", class_="key robot"), "end, and where it faces"),
    ]
    known = [pose for pose in true_trajectory if pose is not None]
    if known:
        keys.append(el("li", el("i", class_="key true-trajectory"), "true trajectory"))
    if any(row.true_m for row in found.evaluation_rows or []):
        keys.append(el("li", el("i", class_="key footprint"), "true footprint"))
    if any(row.state == "missed" for row in found.evaluation_rows or []):
        keys.append(el("li", el("b", "×", class_="key-missed"), "missed"))
    if found.zones:
        keys.append(el("li", el("i", class_="key zone"), "zone"))
    rows = found.evaluation_rows or ()
    drawing = floor_svg(found.objects, [sample.pose_map_base for sample in trajectory], known, rows, found.zones)
    return _section("From above", el("figure", drawing, el("ul", legend, keys, class_="legend")), name="wide")


def _objects(found: Findings) -> Markup:
    rows = found.evaluation_rows or []
    if not found.objects and not rows:
        return _section("Objects", el("p", "Nothing was mapped.", class_="note"))
    note = el("p", _judgement(rows), class_="note") if rows else None
    table = tables.objects_table(found.objects, found.crops, rows, found.history.start_s)
    return _section("Objects", note, table, name="wide")


def _judgement(rows: list[EvaluationRow]) -> str:
    errors = [row.error_m for row in rows if row.state == "found" and row.error_m is not None]
    median = f"; median error of those found {np.median(errors):.2f} m" if errors else ""
    return f"Against the truth: {tally(rows)}{median}. Found: same class within 0.5 m; misplaced: within 1.5 m."


def _trajectory(trajectory: list[PoseSample], errors_m: list[float]) -> Markup | None:
    if len(trajectory) < 2 or not (errors_m or any(sample.bound_m for sample in trajectory)):
        return None
    if errors_m:
        rms = float(np.sqrt(np.mean(np.square(errors_m))))
        figures = f"{rms:.3f} m RMS, {max(errors_m):.3f} m at most, {errors_m[-1]:.3f} m at the end"
        text = f"Position error against the truth: {figures}. Shade: the run's own estimate, 95 %."
    else:
        text = f"No truth is known; the run's own 95 % bound is {trajectory[-1].bound_m:.2f} m at the end."
    return _section("Trajectory", el("p", text, class_="note"), charts.bound_chart(trajectory, errors_m or None))


def _timeline(found: Findings) -> Markup | None:
    if not any(one.seen for one in found.history.windows):
        return None
    text = "Boxes by label over time, with their number. Grey: detected, never mapped."
    strips = charts.timeline(found.history.windows, found.record.get("mapped", []))
    return _section("Detections", el("p", text, class_="note"), strips)


def _latency(found: Findings) -> Markup | None:
    stages_ms, history = found.record.get("stages_ms", {}), found.history
    if not stages_ms or len(history.windows) < 2:
        return None
    text = "Milliseconds of each stage, stacked; the thin line is the slowest step."
    total = percentiles(list(history.totals_ms))
    drawing = charts.latency_chart(history.windows, list(stages_ms))
    return _section("Latency", el("p", text, class_="note"), drawing, tables.stage_table(stages_ms, total))


def _mount(found: Findings) -> Markup | None:
    if not found.mount_jpeg:
        return None
    text = "The first picture with horizon and metre grid. Where the mount is right, the grid lies flat on the floor."
    return _section(
        "Mount", el("p", text, class_="note"), el("img", src=data_uri(found.mount_jpeg), alt=text, class_="mount")
    )


def _section(title: str, *children: Markup | None, name: str | None = None) -> Markup:
    return el("section", el("h2", title), joined(*children), class_=name)


def _folded(title: str, *children: Markup) -> Markup:
    """A section that opens when asked; printers and searches find it all the same."""
    return el("section", el("details", el("summary", el("h2", title)), joined(*children)), class_="wide")
