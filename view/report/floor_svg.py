"""The floor from above as SVG: x forward is up, y left is left, one scale for both."""

import math
from collections.abc import Sequence

import numpy as np

from edgemap.geometry.grid.occupancy_grid import UNKNOWN, OccupancyGrid
from edgemap.geometry.map_object import MapObject, ellipse_95, radius_m
from edgemap.geometry.objects.edits import Zone
from edgemap.geometry.objects.evaluation_row import EvaluationRow
from edgemap.geometry.se2 import SE2
from edgemap.runtime.frames.colours import label_colour
from edgemap.runtime.outputs.mapfiles.labels import place_labels
from edgemap.runtime.outputs.verdict.verdict import is_doubtful
from edgemap.view.report.floor_picture import Sheet, observed_floor
from edgemap.view.report.markup import Markup, el, joined, polyline
from edgemap.view.report.tables import mark_shape

WIDEST_PX, TALLEST_PX, MARGIN_M = 960.0, 720.0, 0.5
LONGEST_AXIS_M = 3.0  # an ellipse larger than this does not stretch the drawing
_STEPS_M = (0.25, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0, 200.0, 500.0, 1000.0)


def floor_svg(
    objects: Sequence[MapObject],
    trajectory: Sequence[SE2],
    true_trajectory: Sequence[SE2] = (),
    evaluation_rows: Sequence[EvaluationRow] = (),
    zones: Sequence[Zone] = (),
    grid: OccupancyGrid | None = None,
) -> Markup:
    """Draws the map from above as SVG: objects with size, 95 % ellipse and name, the trajectory with start and end,
    true objects, zones, grid lines and scale, with the observed floor as background.
    """
    sheet = _sheet(objects, trajectory, true_trajectory, evaluation_rows, zones, grid)
    marks = [_object(sheet, item) for item in sorted(objects, key=radius_m, reverse=True)]  # small ones on top
    spots = [sheet.at(item.position_m) for item in objects]
    marked = [(item.name or item.id, float(spot[0]), float(spot[1])) for item, spot in zip(objects, spots, strict=True)]
    names = place_labels(marked, sheet.width_px, sheet.height_px)
    texts = [_name(item, spot) for item, spot in zip(objects, names, strict=True)]
    return el(
        "svg",
        observed_floor(sheet, grid) if grid is not None else None,
        _grid(sheet),
        [_zone(sheet, zone) for zone in zones],
        [_truth(sheet, evaluation_row, objects) for evaluation_row in evaluation_rows],
        _line(sheet, true_trajectory, "true-trajectory", "true trajectory"),
        _line(sheet, trajectory, "trajectory", "trajectory"),
        marks,
        [_spot(sheet, item) for item in objects],
        _robot(sheet, trajectory),
        texts,
        _scale_bar(sheet),
        class_="floor",
        viewBox=f"0 0 {sheet.width_px:.0f} {sheet.height_px:.0f}",
        role="img",
        aria_label=f"map from above with {len(objects)} objects",
    )


def _sheet(
    objects: Sequence[MapObject],
    trajectory: Sequence[SE2],
    true_trajectory: Sequence[SE2],
    evaluation_rows: Sequence[EvaluationRow],
    zones: Sequence[Zone],
    grid: OccupancyGrid | None,
) -> Sheet:
    points = [np.zeros((1, 2)), *(np.array(zone.corners_m) for zone in zones)]
    points += [np.array([[pose.x_m, pose.y_m] for pose in poses]) for poses in (trajectory, true_trajectory) if poses]
    if grid is not None and (grid.cells != UNKNOWN).any():
        points.append(grid.centres_m(grid.cells != UNKNOWN))
    for item in objects:
        reach = max(radius_m(item), min(ellipse_95(item.covariance_m2)[0], LONGEST_AXIS_M))
        points.append(item.position_m + reach * np.array([[1, 1], [-1, -1]]))
    for evaluation_row in evaluation_rows:
        points.append(
            np.array(evaluation_row.footprint_m or ([evaluation_row.true_m] if evaluation_row.true_m else [])).reshape(
                -1, 2
            )
        )
    every = np.concatenate(points)
    low, high = every.min(axis=0) - MARGIN_M, every.max(axis=0) + MARGIN_M
    deep_m, wide_m = np.maximum(high - low, 3.0)
    px_per_m = min(WIDEST_PX / wide_m, TALLEST_PX / deep_m)
    wide_m = max(wide_m, 0.8 * WIDEST_PX / px_per_m)  # a narrow way stands in the middle of a sheet of usual shape
    deep_m = max(deep_m, 0.35 * WIDEST_PX / px_per_m)
    top, left = (high + low) / 2.0 + np.array([deep_m, wide_m]) / 2.0
    return Sheet(float(top), float(left), float(px_per_m), float(wide_m * px_per_m), float(deep_m * px_per_m))


def _object(sheet: Sheet, item: MapObject) -> Markup:
    x, y = sheet.at(item.position_m)
    long, short, yaw_rad = ellipse_95(item.covariance_m2)
    colour, scale = label_colour(item.label), sheet.px_per_m
    rotated = f"translate({x:.1f} {y:.1f}) rotate({-90.0 - math.degrees(yaw_rad):.1f})"
    title = (
        f"{item.id}: x {item.position_m[0]:.2f} m, y {item.position_m[1]:.2f} m, seen {item.count} times, "
        f"confidence {item.confidence:.2f}"
    )
    return el(
        "g",
        el("title", title),
        el("circle", cx=x, cy=y, r=radius_m(item) * scale, class_="size"),
        el("ellipse", rx=long * scale, ry=short * scale, class_="bound", transform=rotated),
        class_="object doubtful" if is_doubtful(item) else "object",
        style=f"color:{colour}",
    )  # fmt: skip


def _spot(sheet: Sheet, item: MapObject) -> Markup:
    """The object's place, over all that is drawn of its neighbours."""
    x, y = sheet.at(item.position_m)
    return mark_shape(item.label, x, y, 5.0, class_="spot", style=f"color:{label_colour(item.label)}")


def _zone(sheet: Sheet, zone: Zone) -> Markup:
    corners = sheet.at(np.array(zone.corners_m))
    x, y = (corners[:, 0].min() + corners[:, 0].max()) / 2.0, corners[:, 1].min() - 5.0
    name = el("text", zone.name, x=x, y=y, text_anchor="middle", class_="name")
    return el("g", el("polygon", points=polyline(corners)), name, class_="zone")


def _name(item: MapObject, spot: tuple[float, float, str]) -> Markup:
    """The name beside its object; of an id on a narrow screen the number alone, its mark shows the label."""
    x, y, anchor = spot
    kind = "name doubtful" if is_doubtful(item) else "name"
    if item.name:
        return el("text", item.name, x=x, y=y, text_anchor=anchor, class_=kind)
    word, dash, number = item.id.rpartition("-")
    return el("text", el("tspan", word + dash, class_="word"), number, x=x, y=y, text_anchor=anchor, class_=kind)


def _truth(sheet: Sheet, evaluation_row: EvaluationRow, objects: Sequence[MapObject]) -> Markup | None:
    if evaluation_row.true_m is None:
        return None
    x, y = sheet.at(evaluation_row.true_m)
    mapped = next((item for item in objects if item.id == evaluation_row.object_id), None)
    error = "" if evaluation_row.error_m is None else f", {evaluation_row.error_m:.2f} m off"
    shape = (
        el("polygon", points=polyline(sheet.at(evaluation_row.footprint_m)), class_="footprint")
        if len(evaluation_row.footprint_m) >= 3
        else el("rect", x=x - 7, y=y - 7, width=14.0, height=14.0, class_="footprint")
    )
    tie = None
    if mapped is not None:
        end_x, end_y = sheet.at(mapped.position_m)
        tie = el("line", x1=x, y1=y, x2=end_x, y2=end_y, class_="tie")
    cross = f"M{x - 5:.1f} {y - 5:.1f}l10 10m0 -10l-10 10" if evaluation_row.state == "missed" else None
    return el(
        "g",
        el("title", f"true {evaluation_row.label}: {evaluation_row.state}{error}"),
        shape,
        tie,
        el("path", d=cross, class_="cross") if cross else None,
        class_=f"truth {evaluation_row.state}",
        style=f"color:{label_colour(evaluation_row.label)}",
    )


def _line(sheet: Sheet, trajectory: Sequence[SE2], name: str, title: str) -> Markup | None:
    if len(trajectory) < 2:
        return None
    points = sheet.at(np.array([[pose.x_m, pose.y_m] for pose in trajectory]))
    kept = [points[0]]
    for point in points[1:]:
        if np.abs(point - kept[-1]).max() >= 1.0:  # less than a pixel further on is not visible
            kept.append(point)
    return el("polyline", el("title", title), points=polyline([*kept, points[-1]]), class_=name)


def _robot(sheet: Sheet, trajectory: Sequence[SE2]) -> Markup | None:
    if not trajectory:
        return None
    start_x, start_y = sheet.at([trajectory[0].x_m, trajectory[0].y_m])
    x, y = sheet.at([trajectory[-1].x_m, trajectory[-1].y_m])
    rotation = -math.degrees(trajectory[-1].yaw_rad)
    return joined(
        el("circle", el("title", "start"), cx=start_x, cy=start_y, r=6.0, class_="start"),
        el("path", el("title", "end, and where it faces"), d="M0 -12L8.5 9L0 4.5L-8.5 9Z", class_="robot",
           transform=f"translate({x:.1f} {y:.1f}) rotate({rotation:.1f})"),
    )  # fmt: skip


def step_m(px_per_m: float, minimum_px: float) -> float:
    """The smallest round length that is drawn at least this long."""
    return next((step for step in _STEPS_M if step * px_per_m >= minimum_px), _STEPS_M[-1])


def _grid(sheet: Sheet) -> Markup:
    step = step_m(sheet.px_per_m, 56.0)
    low_x, right_y = (
        sheet.top_x_m - sheet.height_px / sheet.px_per_m,
        sheet.left_y_m - sheet.width_px / sheet.px_per_m,
    )
    lines, texts = [], []
    for n in range(math.ceil(low_x / step), math.floor(sheet.top_x_m / step) + 1):
        _, y = sheet.at([n * step, 0.0])
        lines.append(el("line", x1=0, y1=y, x2=sheet.width_px, y2=y, class_="axis" if n == 0 else None))
        if 36 < y < sheet.height_px - 20:
            texts.append(el("text", f"{n * step:g}", x=5, y=y - 4))
    for n in range(math.ceil(right_y / step), math.floor(sheet.left_y_m / step) + 1):
        x, _ = sheet.at([0.0, n * step])
        lines.append(el("line", x1=x, y1=0, x2=x, y2=sheet.height_px, class_="axis" if n == 0 else None))
        if 24 < x < sheet.width_px - 14:
            texts.append(el("text", f"{n * step:g}", x=x + 4, y=sheet.height_px - 6))
    texts.append(el("text", "x forward (up), y left, m", x=5, y=6, class_="unit"))
    return joined(el("g", lines, class_="grid"), el("g", texts, class_="ticks"))


def _scale_bar(sheet: Sheet) -> Markup:
    length_m = step_m(sheet.px_per_m, 70.0)
    right, y = sheet.width_px - 16, sheet.height_px - 26
    left = right - length_m * sheet.px_per_m
    return el(
        "g",
        el("path", d=f"M{left:.1f} {y - 4:.1f}v8m0 -4H{right:.1f}m0 -4v8"),
        el("text", f"{length_m:g} m", x=(left + right) / 2, y=y - 7, text_anchor="middle"),
        class_="scale",
    )
