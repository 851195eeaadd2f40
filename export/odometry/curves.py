"""Training curves of an odometry head: a table, and the paper's figure 6 where matplotlib is installed."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from pathlib import Path
from typing import Any


def write_curves(rows: Sequence[dict[str, Any]], folder: Path) -> None:
    """Write `curves.csv` and, with the extra `plot`, `curves.png`: the loss and the validation drift over the steps."""
    with (folder / "curves.csv").open("w", newline="") as stream:
        writer = csv.DictWriter(stream, list(dict.fromkeys(key for row in rows for key in row)))
        writer.writeheader()
        writer.writerows(rows)
    try:
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure
    except ImportError:
        return
    figure = Figure(figsize=(9.0, 3.6), layout="constrained")
    FigureCanvasAgg(figure)
    left, right = figure.subplots(1, 2)
    steps = [row["steps"] for row in rows]
    for part in ("loss", "motion", "coarse"):
        if any(part in row for row in rows):
            left.plot(steps, [row.get(part) for row in rows], marker="o", markersize=3, label=part)
    left.set(xlabel="steps of training", ylabel="loss")
    for part, label in (("t5_percent", "over 5 m"), ("t2_percent", "over 2 m"), ("t1_percent", "over 1 m")):
        if any(part in row for row in rows):
            right.plot(steps, [row.get(part) for row in rows], marker="o", markersize=3, label=label)
    right.set(xlabel="steps of training", ylabel="validation drift, % of the way", ylim=(0, None))
    for axes in (left, right):
        axes.grid(alpha=0.3)
        axes.legend(frameon=False)
    figure.savefig(folder / "curves.png", dpi=110)
