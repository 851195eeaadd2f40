"""The report's tables: objects with their pictures and their truth, stages, faults, configuration."""

from collections.abc import Mapping, Sequence
from typing import Any

from edgemap.geometry.map_object import MapObject
from edgemap.geometry.objects.evaluation_row import EvaluationRow
from edgemap.runtime.frames.colours import SHAPES, label_colour, label_mark
from edgemap.runtime.outputs.verdict.causes import cause_of_fault
from edgemap.runtime.outputs.verdict.verdict import sigma_of
from edgemap.view.report.charts import STAGE_COLOURS, duration
from edgemap.view.report.crops import Crop
from edgemap.view.report.markup import Markup, data_uri, el, joined, polyline, prose

MAXIMUM_FAULTS = 60


def mark_shape(label: str, x: float, y: float, radius: float, **attributes: object) -> Markup:
    """The mark of a label as an SVG shape; its colour is the CSS `color` of its parent."""
    corners = SHAPES[label_mark(label).shape]
    if not corners:
        return el("circle", cx=x, cy=y, r=radius, **attributes)
    return el("polygon", points=polyline((x + radius * u, y + radius * v) for u, v in corners), **attributes)


def swatch(label: str) -> Markup:
    """The mark of a label, as large as a letter."""
    shape = mark_shape(label, 8.0, 8.0, 5.0, fill="currentColor")
    return el("svg", shape, class_="swatch", viewBox="0 0 16 16", style=f"color:{label_colour(label)}")


def pill(state: str) -> Markup:
    """An evaluation state as a small badge."""
    return el("span", state, class_=f"pill {state}")


def objects_table(
    objects: Sequence[MapObject], crops: Mapping[str, Crop], evaluation_rows: Sequence[EvaluationRow], start_s: float
) -> Markup:
    """A row per object, with its true object where there is one, then the missed ones; cards on a narrow
    screen."""
    judged = bool(evaluation_rows)
    row_of = {row.object_id: row for row in evaluation_rows if row.object_id}
    rows = [_object_row(item, crops.get(item.id), row_of.get(item.id), judged, start_s) for item in objects]
    rows += [_missed_row(row) for row in evaluation_rows if row.object_id is None]
    truth = ("error", "in its 95 % ellipse") if judged else ()
    heads = ("", "object", "x, y", "±", *truth, "size", "seen", "confidence", "first – last")
    return el("table", el("thead", el("tr", [el("th", head) for head in heads])), el("tbody", rows), class_="objects")


def _object_row(
    item: MapObject, crop: Crop | None, evaluation_row: EvaluationRow | None, judged: bool, start_s: float
) -> Markup:
    shown = (
        el("img", src=data_uri(crop.jpeg), alt=f"{item.id} in frame {crop.frame}", loading="lazy")
        if crop
        else el("span", "no picture", class_="nothing")
    )
    times = f"{duration(round(item.first_seen_s - start_s, 1))} – {duration(round(item.last_seen_s - start_s, 1))}"
    said = [item.id if item.name else "", "confirmed" if item.confirmed else ""]
    return el(
        "tr",
        el("td", shown, class_="crop"),
        el("td", swatch(item.label), el("b", item.name or item.id), " " if evaluation_row else None,
           pill(evaluation_row.state) if evaluation_row else None,
           el("small", ", ".join(filter(None, said))) if any(said) else None, class_="who"),
        _cell("x, y", f"{item.position_m[0]:.2f}, {item.position_m[1]:.2f} m"),
        _cell("±", f"{sigma_of(item):.2f} m"),
        *(_truth_cells(evaluation_row) if judged else ()),
        _cell("size", f"{item.width_m:.2f} × {item.height_m:.2f} m"),
        _cell("seen", f"{item.count}×"),
        _cell("confidence", el("meter", value=f"{item.confidence:.3f}", min=0, max=1), f" {item.confidence:.2f}"),
        _cell("first – last", times),
    )  # fmt: skip


def _missed_row(row: EvaluationRow) -> Markup:
    """A true object that the map lacks."""
    place = "" if row.true_m is None else f"{row.true_m[0]:.2f}, {row.true_m[1]:.2f} m"
    return el(
        "tr",
        el("td", el("span", "not mapped", class_="nothing"), class_="crop"),
        el("td", swatch(row.label), el("b", row.label), " ", pill(row.state), class_="who"),
        _cell("true x, y", place),
        el("td", colspan=7),
        class_="missed",
    )


def _truth_cells(row: EvaluationRow | None) -> tuple[Markup, Markup]:
    error = "–" if row is None or row.error_m is None else f"{row.error_m:.2f} m"
    covered = "–" if row is None or row.covered is None else ("yes" if row.covered else "no")
    return _cell("error", error), _cell("in its ellipse", covered)


def stage_table(stages_ms: Mapping[str, Mapping[str, float]], total: Mapping[str, float]) -> Markup:
    """p50, p95 and p99 of each stage and of the complete step, with bars of p50."""
    longest = max([*(stage.get("p50", 0.0) for stage in stages_ms.values()), 1e-9])
    rows = []
    for index, (name, figures) in enumerate(stages_ms.items()):
        share, colour = 100.0 * figures.get("p50", 0.0) / longest, STAGE_COLOURS[index % len(STAGE_COLOURS)]
        bar = el("i", class_="bar", style=f"width:{share:.1f}%;background:{colour}")
        rows.append(el("tr", el("td", name), el("td", bar, class_="bars"), _figures(figures)))
    if total:
        rows.append(el("tr", el("td", "complete step"), el("td"), _figures(total), class_="sum"))
    heads = ("stage", "", "p50", "p95", "p99 ms")
    return el(
        "table", el("thead", el("tr", [el("th", head) for head in heads])), el("tbody", rows), class_="plain stages"
    )


def _figures(figures: Mapping[str, float]) -> Markup:
    return joined(
        [el("td", f"{figures[key]:.2f}" if key in figures else "–", class_="figure") for key in ("p50", "p95", "p99")]
    )


def fault_list(record: Mapping[str, Any]) -> Markup:
    """The faults, one a line, or a line that there were none."""
    faults, count = record.get("faults", []), record.get("fault_count", 0)
    if not faults:
        return el("p", "None.", class_="note")
    more = count - min(len(faults), MAXIMUM_FAULTS)
    tail = el("p", f"and {more} more; the first {len(faults)} stand in run.json", class_="note") if more > 0 else None
    return joined(el("ol", [_fault(fault) for fault in faults[:MAXIMUM_FAULTS]], class_="faults"), tail)


def _fault(text: str) -> Markup:
    """A fault, and its remedy where there is one."""
    cause = cause_of_fault(text)
    return el("li", text, el("small", prose(f"{cause.remedy} ({cause.link})")) if cause else None)


def settings_table(record: Mapping[str, Any]) -> Markup:
    """The resolved configuration, nested keys joined by dots."""
    skipped = {"stages_ms", "faults", "verdict", "fault_count", "merged", "format", "finished", "frames", "seconds"}
    rows = [
        el("tr", el("th", key), el("td", value))
        for key, value in _flat({key: value for key, value in record.items() if key not in skipped})
    ]
    return el("table", el("tbody", rows), class_="settings")


def _flat(value: Mapping[str, Any], before: str = "") -> list[tuple[str, str]]:
    found: list[tuple[str, str]] = []
    for key, item in value.items():
        name = f"{before}{key}"
        if isinstance(item, Mapping):
            found += _flat(item, f"{name}.") if item else [(name, "none")]
        elif isinstance(item, list):
            found.append((name, ", ".join(map(str, item)) or "none"))
        else:
            found.append((name, str(item)))
    return found


def _cell(head: str, *children: str | Markup) -> Markup:
    return el("td", *children, data_head=head, class_="figure")
