"""Training curves: a table, and a picture where matplotlib is installed."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any


@dataclass(frozen=True, slots=True)
class Panel:
    """One pair of axes. lines: columns of the table to their names in the legend; a column without values is left out.

    top: upper end of the ordinate, which begins at 0; None draws what there is.
    """

    title: str
    lines: dict[str, str]
    from_zero: bool = True
    top: float | None = None


def write_curves(rows: Sequence[dict[str, Any]], folder: Path, over: tuple[str, str], panels: Sequence[Panel]) -> None:
    """Write `curves.csv` and, with the extra `plot`, `curves.png`. over: the abscissa's column and its name."""
    with (folder / "curves.csv").open("w", newline="") as stream:
        writer = csv.DictWriter(stream, list(dict.fromkeys(key for row in rows for key in row)))
        writer.writeheader()
        writer.writerows(rows)
    try:
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure
    except ImportError:
        return
    figure = Figure(figsize=(4.5 * len(panels), 3.6), layout="constrained")
    FigureCanvasAgg(figure)
    column, name = over
    for axes, panel in zip(figure.subplots(1, len(panels), squeeze=False)[0], panels, strict=True):
        for part, label in panel.lines.items():
            if any(part in row for row in rows):
                axes.plot(
                    [row[column] for row in rows], [row.get(part) for row in rows], "o-", markersize=3, label=label
                )
        axes.set(xlabel=name, ylabel=panel.title)
        if panel.from_zero:
            axes.set_ylim(0.0, panel.top)
        axes.grid(alpha=0.3)
        axes.legend(frameon=False)
    figure.savefig(folder / "curves.png", dpi=110)
