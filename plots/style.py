"""Style of the figures: colours by label; floor plans with forward up and left on the left."""

from collections.abc import Iterable, Sequence
from io import BytesIO
from pathlib import Path

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure
from matplotlib.path import Path as MplPath
from matplotlib.patheffects import withStroke
from numpy.typing import NDArray

from edgemap.geometry.errors import EdgemapError
from edgemap.runtime.frames.colours import SHAPES, label_colour, label_mark
from edgemap.runtime.frames.disk import make_folder, write_atomically
from edgemap.runtime.frames.errors import DiskError
from edgemap.runtime.outputs.mapfiles.labels import TEXT_PX, place_labels

mpl.use("Agg")
mpl.rcParams["text.parse_math"] = False  # labels and ids come from files: a dollar sign is one

__all__ = [
    "Axes", "Figure", "PlotError", "end_where_the_data_ends", "floor_axes", "label_colours", "label_marker",
    "plt", "save", "write_names",
]  # fmt: skip


class PlotError(EdgemapError):
    """A figure that cannot be written."""


NAME_PT, MARGIN_M = 8.0, 0.3
INK, PAPER, GRID = "#22272e", "#ffffff", "#e6e8eb"


def label_colours(labels: Iterable[str]) -> dict[str, tuple[float, float, float, float]]:
    """Each label's colour, the same in every figure and on the live page, as RGBA in 0..1."""
    return {label: to_rgba(label_colour(label)) for label in sorted(set(labels))}


def label_marker(label: str) -> str | MplPath:
    """The shape of a label's mark, as matplotlib's `marker`."""
    corners = SHAPES[label_mark(label).shape]
    if not corners:
        return "o"
    points = [(x, -y) for x, y in corners]
    return MplPath([*points, points[0]], closed=True)


def end_where_the_data_ends(axes: Axes, points_m: NDArray[np.float64]) -> None:
    """Limits of a floor's axes around points (N, 2) of x forward, y left."""
    low, high = points_m.min(axis=0) - MARGIN_M, points_m.max(axis=0) + MARGIN_M
    axes.set_ylim(low[0], high[0])
    axes.set_xlim(high[1], low[1])


def write_names(figure: Figure, axes: Axes, names: Sequence[tuple[str, float, float]]) -> None:
    """Texts beside points (text, x forward, y left), where they cover each other and the points least.

    Call it last: it needs to know where everything stands.
    """
    figure.canvas.draw()
    px_per_pt = figure.dpi / 72.0
    unit = TEXT_PX / (NAME_PT * px_per_pt)  # of the placement, in which a text is TEXT_PX high
    box = axes.get_window_extent()
    spots = [axes.transData.transform((y_m, x_m)) for _, x_m, y_m in names]
    marks = [
        (text, (px - box.x0) * unit, (box.y1 - py) * unit) for (text, _, _), (px, py) in zip(names, spots, strict=True)
    ]
    anchors = {"start": "left", "middle": "center", "end": "right"}
    placed = place_labels(marks, box.width * unit, box.height * unit)
    for (text, at_x, at_y), (x, y, anchor), (_, x_m, y_m) in zip(marks, placed, names, strict=True):
        offset = ((x - at_x) / unit / px_per_pt, (at_y - y) / unit / px_per_pt)
        axes.annotate(
            text, (y_m, x_m), textcoords="offset points", xytext=offset, ha=anchors[anchor], va="baseline",
            fontsize=NAME_PT, color=INK, zorder=6, path_effects=[withStroke(linewidth=2.0, foreground=PAPER)],
        )  # fmt: skip


def floor_axes(axes: Axes, title: str, frame: str) -> None:
    """Dress axes as the floor from above: x forward is up, y left is left, one scale for both, metres."""
    axes.set_title(title, fontsize=11, color=INK, loc="left")
    axes.set_xlabel(f"y left (m), {frame} frame", fontsize=9)
    axes.set_ylabel(f"x forward (m), {frame} frame", fontsize=9)
    axes.set_aspect("equal", adjustable="box")
    axes.grid(color=GRID, linewidth=0.8)
    axes.set_axisbelow(True)
    axes.tick_params(labelsize=8)
    axes.spines[["top", "right"]].set_visible(False)
    if not axes.xaxis_inverted():
        axes.invert_xaxis()


def save(figure: Figure, path: Path) -> Path:
    """Write a figure, PNG or SVG by the path's ending, making its folder; the path. Raises PlotError."""
    if path.suffix.lower() not in (".png", ".svg"):
        raise PlotError(f"{path}: pictures are .png or .svg")
    try:
        drawn = BytesIO()
        figure.savefig(drawn, format=path.suffix[1:].lower(), dpi=130, facecolor=PAPER, bbox_inches="tight")
    finally:
        plt.close(figure)
    try:
        make_folder(path.parent)
        write_atomically(path, drawn.getvalue())  # a link in a folder of a stranger's is replaced, not written through
    except DiskError as error:
        raise PlotError(str(error)) from None
    return path
