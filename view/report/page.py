"""Builds the report: one self-contained HTML file."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from edgemap.geometry.grid.occupancy_grid import OccupancyGrid
from edgemap.geometry.map_object import MapObject
from edgemap.geometry.objects.edits import Zone
from edgemap.geometry.objects.evaluation_row import EvaluationRow, tally
from edgemap.geometry.se2 import SE2
from edgemap.runtime.frames.errors import OdometryError
from edgemap.runtime.frames.timing import percentiles
from edgemap.runtime.frames.trajectory import Trajectory
from edgemap.runtime.outputs.verdict.explain import verdict_or_none
from edgemap.runtime.outputs.verdict.verdict import TITLES, is_doubtful
from edgemap.view.report import charts, tables
from edgemap.view.report.crops import Crop
from edgemap.view.report.floor_svg import floor_svg
from edgemap.view.report.history import History, PoseSample
from edgemap.view.report.markup import Markup, data_uri, el, joined, prose

# The browser itself refuses whatever the page might ask for.
MAXIMUM_DRAWN = 1000  # objects: a page of two megabytes
_POLICY = "default-src 'none'; img-src data:; style-src 'unsafe-inline'"


@dataclass(frozen=True, slots=True)
class ReportContent:
    """All contents of a report. record: what run.json holds. truth: of the base from its start, None where unknown.
    evaluation_rows: empty without truth. mount_jpeg: the first picture with horizon and metre grid."""

    record: dict[str, Any]
    objects: list[MapObject]
    history: History
    crops: dict[str, Crop] = field(default_factory=dict)
    truth: Trajectory | None = None
    evaluation_rows: list[EvaluationRow] | None = None
    mount_jpeg: bytes | None = None
    zones: tuple[Zone, ...] = ()
    grid: OccupancyGrid | None = None

    @property
    def drawn(self) -> list[MapObject]:
        """The objects that the page shows: all, or the most often observed ones where there are too many."""
        return sorted(self.objects, key=lambda item: -item.count)[:MAXIMUM_DRAWN] if self.crowded else self.objects

    @property
    def crowded(self) -> bool:
        """Whether some objects are omitted."""
        return len(self.objects) > MAXIMUM_DRAWN


def report_page(content: ReportContent) -> str:
    """The complete page as text."""
    trajectory, true_trajectory = content.history.trajectory(), _true_trajectory(content)
    errors_m = _errors(trajectory, true_trajectory)
    title = f"{len(content.objects)} objects on the map"
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
        _masthead(content, title),
        _tiles(content, errors_m),
        _floor(content, trajectory, true_trajectory),
        _objects(content),
        _trajectory(trajectory, errors_m),
        _timeline(content),
        _latency(content),
        _mount(content),
        _section("Faults", tables.fault_list(content.record), name="wide"),
        _folded("Configuration", tables.settings_table(content.record)),
        el(
            "footer", "Written by edgemap run. Positions in the map frame: origin at the first pose, x forward, y left."
        ),
    ]
    page = el("html", head, el("body", el("main", sections)), lang="en")
    return f"<!doctype html>\n{page}\n"


def _true_trajectory(content: ReportContent) -> list[SE2 | None]:
    """The true pose at each pose sample, None where unknown."""
    poses: list[SE2 | None] = []
    for sample in content.history.trajectory():
        try:
            poses.append(content.truth.at(sample.stamp_s) if content.truth else None)
        except OdometryError:
            poses.append(None)
    return poses


def _errors(trajectory: Sequence[PoseSample], true_trajectory: Sequence[SE2 | None]) -> list[float]:
    """Position errors in metres; empty unless the truth covers the complete trajectory."""
    errors_m = []
    for sample, true in zip(trajectory, true_trajectory, strict=True):
        if true is None:
            return []
        errors_m.append(float(np.hypot(sample.pose_map_base.x_m - true.x_m, sample.pose_map_base.y_m - true.y_m)))
    return errors_m


def _masthead(content: ReportContent, title: str) -> Markup:
    record = content.record
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
        _verdict(content),
    )


def _verdict(content: ReportContent) -> Markup | None:
    """How far the map can be trusted, why, and what to do about the gravest cause."""
    verdict = verdict_or_none(content.record, content.objects)
    if verdict is None:
        return None
    reasons = [el("li", finding.text, ". ", el("span", prose(finding.cause.remedy))) for finding in verdict.findings]
    return el(
        "div",
        el("p", el("b", f"Map: {TITLES[verdict.level]}.")),
        el("ul", reasons) if reasons else None,
        class_=f"verdict {verdict.level}",
    )


def _tiles(content: ReportContent, errors_m: list[float]) -> Markup:
    record, history = content.record, content.history
    span_s = history.last_s - history.start_s
    frames, seconds = record.get("frames", history.frames), record.get("seconds", 0.0)
    tiles = [
        ("objects", f"{len(content.objects)}"),
        ("path", f"{history.path_m:.1f} m"),
        ("drive", charts.duration(round(span_s, 1))),
    ]
    tiles += [("frames", f"{frames}"), ("frames/s", f"{frames / seconds:.0f}" if seconds else "–")]
    if history.totals_ms:
        tiles.append(("step, p95", f"{percentiles(list(history.totals_ms))['p95']:.1f} ms"))
    if content.evaluation_rows:
        wanted = [row for row in content.evaluation_rows if row.state in ("found", "misplaced", "missed")]
        tiles.append(("found", f"{sum(row.state == 'found' for row in wanted)} of {len(wanted)}"))
    if errors_m:
        tiles.append(("off at the end", f"{errors_m[-1]:.2f} m"))
    return el("dl", [el("div", el("dt", name), el("dd", value)) for name, value in tiles], class_="tiles")


def _floor(content: ReportContent, trajectory: list[PoseSample], true_trajectory: list[SE2 | None]) -> Markup:
    labels = sorted(
        {item.label for item in content.objects} | {row.label for row in content.evaluation_rows or [] if row.true_m}
    )
    legend = [el("li", tables.swatch(label), label) for label in labels]
    known = [pose for pose in true_trajectory if pose is not None]
    rows = content.evaluation_rows or ()
    shown = {
        "disc": ("floor it takes, as a circle", True),
        "ellipse": ("95 % ellipse", True),
        "ellipse faint": ("of a doubtful object", any(is_doubtful(item) for item in content.drawn)),
        "trajectory": ("trajectory", True),
        "start": ("start", True),
        "robot": ("end, and where it faces", True),
        "true-trajectory": ("true trajectory", known),
        "footprint": ("true footprint", any(row.true_m for row in rows)),
        "missed": ("missed", any(row.state == "missed" for row in rows)),
        "free": ("seen floor", content.grid is not None),
        "wall": ("wall or obstacle", content.grid is not None),
        "zone": ("zone", content.zones),
    }
    marks = {"missed": el("b", "×", class_="key-missed")}
    keys = [
        el("li", marks.get(key, el("i", class_=f"key {key}")), text) for key, (text, drawn) in shown.items() if drawn
    ]
    driven = [sample.pose_map_base for sample in trajectory]
    drawing = floor_svg(content.drawn, driven, known, rows, content.zones, content.grid)
    return _section("From above", el("figure", drawing, el("ul", legend, keys, class_="legend")), name="wide")


def _objects(content: ReportContent) -> Markup:
    rows = content.evaluation_rows or []
    if not content.objects and not rows:
        return _section("Objects", el("p", "Nothing was mapped.", class_="note"))
    note = el("p", _judgement(rows), class_="note") if rows else None
    if content.crowded:
        note = el("p", f"The {MAXIMUM_DRAWN} objects observed most often, of {len(content.objects)}.", class_="note")
    table = tables.objects_table(content.drawn, content.crops, rows, content.history.start_s)
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


def _timeline(content: ReportContent) -> Markup | None:
    if not any(one.seen for one in content.history.windows):
        return None
    text = "Boxes by label over time, with their number. Grey: detected, never mapped."
    strips = charts.timeline(content.history.windows, content.record.get("mapped", []))
    return _section("Detections", el("p", text, class_="note"), strips)


def _latency(content: ReportContent) -> Markup | None:
    stages_ms, history = content.record.get("stages_ms", {}), content.history
    if not stages_ms or len(history.windows) < 2:
        return None
    text = "Milliseconds of each stage, stacked; the thin line is the slowest step."
    total = percentiles(list(history.totals_ms))
    drawing = charts.latency_chart(history.windows, list(stages_ms))
    return _section("Latency", el("p", text, class_="note"), drawing, tables.stage_table(stages_ms, total))


def _mount(content: ReportContent) -> Markup | None:
    if not content.mount_jpeg:
        return None
    text = "The first picture with horizon and metre grid. Where the mount is right, the grid lies flat on the floor."
    return _section(
        "Mount", el("p", text, class_="note"), el("img", src=data_uri(content.mount_jpeg), alt=text, class_="mount")
    )


def _section(title: str, *children: Markup | None, name: str | None = None) -> Markup:
    return el("section", el("h2", title), joined(*children), class_=name)


def _folded(title: str, *children: Markup) -> Markup:
    """A section that opens when asked; printers and searches find it all the same."""
    return el("section", el("details", el("summary", el("h2", title)), joined(*children)), class_="wide")
