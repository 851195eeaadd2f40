"""The page of `paper_tables`: our figures as Markdown tables, within paper_tables.md, which has the paper's own."""

import re
from collections.abc import Callable, Sequence
from pathlib import Path
from statistics import fmean
from string import Template
from typing import Any

from edgemap.runtime.network.engines import processor_name

TEMPLATE = Path(__file__).with_name("paper_tables.md")
NONE = "–"


def page(document: dict[str, Any]) -> str:
    """All tables of the figures of `measure`."""
    threads, parameters = document["threads"], {"paper head": document["parameters"].get("paper", 0)}
    dashes = [f"- {column}: {reason}." for column, reason in document["lacking"].items()]
    pictures = [f"![{name}]({path})" for name, path in document["ways"].items()]
    text = Template(TEMPLATE.read_text()).substitute(
        bundle=document["bundle"],
        data=_data(document),
        lacking="\n".join(["A dash stands where there is nothing to measure:", "", *dashes]) if dashes else "",
        detections=_detections(document["detections"]),
        paper_rmse=_odometry(document, lambda own: own["paper_rmse"]),
        t_rel_mean=_odometry(document, lambda own: own["t_rel_mean_percent"]),
        parameters=" | ".join(
            NONE if column in document["lacking"] else f"{parameters.get(column, 0):,}"
            for column in document["columns"]
        ),
        t_rel=_odometry(document, lambda own: own["t_rel_percent"].get("5", own["t_rel_percent"].get("100"))),
        ate=_odometry(document, lambda own: own["ate_m"]),
        hardware=f"{threads} thread{'s' if threads > 1 else ''} of {processor_name()}",
        ways="\n".join(["## Fig. 7: ways over the true ones", "", *pictures]) if pictures else "",
    )
    return re.sub(r"\n{3,}", "\n\n", text).rstrip() + "\n"


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A Markdown table."""
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(cells) + " |" for cells in lines)


def _data(document: dict[str, Any]) -> str:
    drives = next(iter(document["odometry"].values()))["sequences"]
    rows = [
        [name, f"`{document['data'][name]}`", f"{own['frames']}", f"{own['rate_hz']:g}", f"{own['path_m']:.1f}",
         f"{own['mount']['height_m']:.2f}", f"{own['mount']['pitch_deg']:.1f}"]
        for name, own in drives.items()
    ]  # fmt: skip
    return table(["sequence", "data", "frames", "Hz", "way, m", "camera height, m", "pitch, deg down"], rows)


def _detections(found: dict[str, dict[str, Any] | None]) -> str:
    head = ["sequence", "frames", "chairs", "found", "false", "missed", "all mapped", "found", "false", "missed"]
    known = [own for own in found.values() if own is not None]
    rows = [[name, *([NONE] * 9 if own is None else _counts([own]))] for name, own in found.items()]
    if len(known) > 1:
        rows.append(["**all**", *_counts(known)])
    without = "" if len(known) == len(found) else "\n\nA dash: no true boxes come with that sequence."
    return table(head, rows) + without


def _counts(several: Sequence[dict[str, Any]]) -> list[str]:
    """Frames, and counts of chairs and of all mapped classes, of several sequences together."""
    counts = [
        sum(own[kind][key] for own in several)
        for kind in ("chair", "mapped")
        for key in ("true", "found", "false", "missed")
    ]
    return [str(sum(own["frames"] for own in several)), *map(str, counts)]


def _odometry(document: dict[str, Any], figure: Callable[[dict[str, Any]], float | None]) -> str:
    """One figure of each sequence and odometry; mean and worst, of rooms and roads apart."""
    columns = document["columns"]
    scored = [document["odometry"].get(column, {"sequences": {}})["sequences"] for column in columns]
    values = {name: [figure(own[name]) if name in own else None for own in scored] for name in document["data"]}
    rows = [[name, *map(_number, row)] for name, row in values.items()]
    roads = [name for name, spec in document["data"].items() if spec.startswith("kitti:")]
    rooms = [name for name in document["data"] if name not in roads]
    for names, where in ((rooms, " indoors" if roads else ""), (roads, " on roads" if rooms else "")):
        for title, over in (("mean", fmean), ("worst", max)) if len(names) > 1 else ():
            across = zip(*(values[name] for name in names), strict=True)
            known = [[value for value in column if value is not None] for column in across]
            rows.append([f"**{title}{where}**", *(_number(over(own) if own else None) for own in known)])
    return table(["sequence", *columns], rows)


def _number(value: float | None) -> str:
    return NONE if value is None else f"{value:.2f}"
