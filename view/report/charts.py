"""Charts over time: the drawing stretches to any width, its words are HTML beside it and stay readable on a phone."""

import math
from collections import Counter
from collections.abc import Sequence
from itertools import accumulate

import numpy as np

from edgemap.runtime.frames.colours import label_colour
from edgemap.view.report.history import PoseSample, TimeWindow
from edgemap.view.report.markup import Markup, el, polyline

MAXIMUM_ROWS = 14
# Stages in the order of the step, from dark to light and warm; apart from the labels' colours.
STAGE_COLOURS = ("#7f93ad", "#3f5f86", "#a9bcd3", "#6b8f8a", "#c98f57", "#8d6a97", "#d9bf94", "#9aa67a")
_W, _H = 1000.0, 100.0


def latency_chart(stretches: Sequence[TimeWindow], stages: Sequence[str]) -> Markup:
    """Mean milliseconds of each stage stacked over time, with the slowest step of each stretch as a thin line."""
    middle = _middles(stretches)
    means = np.array([[one.stages_ms[stage] / one.frames for stage in stages] for one in stretches])
    worst = np.array([one.worst_ms for one in stretches])
    totals = means.sum(axis=1)
    top = nice_top(min(float(worst.max()), 2.5 * float(np.percentile(totals, 95))))
    edges = np.column_stack([np.zeros(len(means)), *accumulate(means.T)])
    x = _across(middle, stretches[0].start_s, stretches[-1].end_s)
    areas = []
    for index, stage in enumerate(stages):
        upper, lower = edges[:, index + 1], edges[:, index]
        points = [*zip(x, _up(upper, top), strict=True), *zip(x[::-1], _up(lower[::-1], top), strict=True)]
        colour = STAGE_COLOURS[index % len(STAGE_COLOURS)]
        areas.append(el("polygon", el("title", stage), points=polyline(points), fill=colour))
    line = el(
        "polyline", el("title", "slowest step"), points=polyline(zip(x, _up(worst, top), strict=True)), class_="thin"
    )
    return chart([*areas, line], top, "ms", stretches[-1].end_s - stretches[0].start_s, "latency over time")


def bound_chart(trajectory: Sequence[PoseSample], errors_m: Sequence[float] | None) -> Markup:
    """The position error over time, where known, over the stated 95 % bound."""
    stamps, bounds = [sample.stamp_s for sample in trajectory], [sample.bound_m for sample in trajectory]
    chosen = np.unique(np.linspace(0, len(trajectory) - 1, min(len(trajectory), 600)).astype(int))
    highest = float(np.max([*bounds, *(errors_m or [])]))
    if errors_m and max(errors_m) > 0:  # a bound far above the error would flatten it
        highest = min(highest, 4.0 * max(errors_m))
    top = nice_top(highest)
    x = _across(np.array(stamps)[chosen], stamps[0], stamps[-1])
    shade = [*zip(x, _up(np.array(bounds)[chosen], top), strict=True), (x[-1], _H), (x[0], _H)]
    marks = [
        el(
            "polygon",
            el("title", "95 % bound by the pipeline's own covariance"),
            points=polyline(shade),
            class_="shade",
        )
    ]
    if errors_m:
        line = zip(x, _up(np.array(errors_m)[chosen], top), strict=True)
        marks.append(el("polyline", el("title", "position error"), points=polyline(line), class_="line"))
    return chart(marks, top, "m", stamps[-1] - stamps[0], "position error over time")


def timeline(stretches: Sequence[TimeWindow], mapped: Sequence[str]) -> Markup:
    """One strip per label, the most frequent first; darker means more boxes per frame. Labels never mapped are grey."""
    seen: Counter[str] = Counter()
    for one in stretches:
        seen.update(one.seen)
    start_s, end_s = stretches[0].start_s, stretches[-1].end_s
    rows = []
    for label, count in seen.most_common(MAXIMUM_ROWS):
        peak = max(one.seen[label] / one.frames for one in stretches)
        colour = label_colour(label) if label in mapped else "var(--muted)"
        strip = el("svg", _bars(stretches, label, peak), viewBox=f"0 0 {_W:.0f} 10", preserveAspectRatio="none",
                   style=f"color:{colour}", role="img", aria_label=f"{label} over time")  # fmt: skip
        rows.append(
            el("div", el("span", label, class_="label"), strip, el("span", f"{count}", class_="count"), class_="strip")
        )
    more = len(seen) - MAXIMUM_ROWS
    if more > 0:
        rows.append(el("p", f"and {more} labels more, seen less often", class_="note"))
    axis = el(
        "div", el("span"), el("div", _time_marks(end_s - start_s), class_="times"), el("span"), class_="strip axis"
    )
    return el("div", rows, axis, class_="timeline")


def _bars(stretches: Sequence[TimeWindow], label: str, peak: float) -> list[Markup]:
    start_s, span_s = stretches[0].start_s, max(stretches[-1].end_s - stretches[0].start_s, 1e-9)
    starts = [(one.start_s - start_s) / span_s * _W for one in stretches]
    ends = [*starts[1:], _W]
    bars = []
    for one, left, right in zip(stretches, starts, ends, strict=True):
        if one.seen[label]:
            strength = 0.3 + 0.7 * one.seen[label] / one.frames / peak
            bars.append(el("rect", x=left, y=0, width=max(right - left, 3.0), height=10, opacity=strength))
    return bars


def chart(marks: Sequence[Markup], top: float, unit: str, span_s: float, label: str) -> Markup:
    """A frame of fixed height with its axes: values from 0 to `top` in `unit`, seconds from 0 to `span_s`."""
    shares = (0.0, 0.5, 1.0)
    lines = [el("line", x1=0, x2=_W, y1=_H * (1 - share), y2=_H * (1 - share), class_="rule") for share in shares]
    levels = [
        el("span", f"{top * share:g}" + (f" {unit}" if share == 1.0 else ""), style=f"bottom:{share * 100:.0f}%")
        for share in shares
    ]
    picture = el(
        "svg", lines, marks, viewBox=f"0 0 {_W:.0f} {_H:.0f}", preserveAspectRatio="none", role="img", aria_label=label
    )
    return el(
        "div",
        el("div", levels, class_="levels"),
        el("div", picture, class_="plot"),
        el("div", _time_marks(span_s), class_="times"),
        class_="chart",
    )


def _time_marks(span_s: float) -> list[Markup]:
    """Round times along the axis, and where they stand."""
    step = _round_up(span_s / 5.0, (1.0, 2.0, 2.5, 5.0, 10.0))
    count = math.floor(span_s / step + 1e-9) if span_s > 0 else 0
    marks = []
    for n in range(count + 1):
        share = n * step / span_s if span_s > 0 else 0.0
        edge = "first" if n == 0 else ("last" if share > 0.95 else None)
        marks.append(el("span", duration(n * step), style=f"left:{100 * share:.2f}%", class_=edge))
    return marks


def duration(seconds: float) -> str:
    """`12 s`, `3:05 min`, `1:02 h`: short, with its unit."""
    if seconds < 120:
        return f"{seconds:g} s" if seconds == round(seconds, 1) else f"{seconds:.1f} s"
    whole = round(seconds)
    return f"{whole // 60}:{whole % 60:02d} min" if whole < 7200 else f"{whole // 3600}:{whole % 3600 // 60:02d} h"


def nice_top(value: float) -> float:
    """Upper end of an axis: the first number with a round half that is at least the value; 1 without values."""
    return _round_up(value, (1.0, 1.2, 1.6, 2.0, 2.4, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0))


def _round_up(value: float, steps: Sequence[float]) -> float:
    """The smallest of these times a power of ten that is not below the value; 1 for nothing."""
    if not value > 0 or not math.isfinite(value):
        return 1.0
    power = 10.0 ** math.floor(math.log10(value))
    return next(step * power for step in steps if step * power >= value * (1 - 1e-9))


def _middles(stretches: Sequence[TimeWindow]) -> np.ndarray:
    return np.array([(one.start_s + one.end_s) / 2.0 for one in stretches])


def _across(stamps_s: np.ndarray, start_s: float, end_s: float) -> np.ndarray:
    return (stamps_s - start_s) / max(end_s - start_s, 1e-9) * _W


def _up(values: np.ndarray, top: float) -> np.ndarray:
    return _H * (1.0 - np.minimum(values / top, 1.0))
