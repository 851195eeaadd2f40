"""Training curves: a table, and a picture where matplotlib is installed."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from pathlib import Path
from typing import Any


def write_curves(rows: Sequence[dict[str, Any]], folder: Path) -> None:
    """Write `curves.csv` and, with the extra `plot`, `curves.png`: losses and average precision over minutes."""
    with (folder / "curves.csv").open("w", newline="") as stream:
        writer = csv.DictWriter(stream, list(rows[0]))
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
    minutes = [row["minutes"] for row in rows]
    for part, label in (("box", "box (1 - GIoU)"), ("objectness", "objectness"), ("classes", "classes")):
        left.plot(minutes, [row[part] for row in rows], marker="o", markersize=3, label=label)
    left.set(xlabel="minutes of training", ylabel="loss per positive cell", ylim=(0, None))
    for key, label in (("ap50", "AP50"), ("ap", "AP 0.50:0.95")):
        right.plot(minutes, [row[key] for row in rows], marker="o", markersize=3, label=label)
    right.set(xlabel="minutes of training", ylabel="validation", ylim=(0, 1))
    for axes in (left, right):
        axes.grid(alpha=0.3)
        axes.legend(frameon=False)
    figure.savefig(folder / "curves.png", dpi=110)
