"""Style of the figures: colours by label; floor plans with forward up and left on the left."""

from collections.abc import Iterable
from io import BytesIO
from pathlib import Path

import matplotlib as mpl
import matplotlib.pyplot as plt
from matplotlib.axes import Axes
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure

from edgemap.geometry.errors import EdgemapError
from edgemap.runtime.frames.colours import label_colour
from edgemap.runtime.frames.disk import make_folder, write_atomically
from edgemap.runtime.frames.errors import DiskError

mpl.use("Agg")
mpl.rcParams["text.parse_math"] = False  # labels and ids come from files: a dollar sign is one

__all__ = [
    "Axes", "Figure", "PlotError", "floor_axes", "label_colours", "plt", "save",
]  # fmt: skip


class PlotError(EdgemapError):
    """A figure that cannot be written."""


INK, PAPER, GRID = "#22272e", "#ffffff", "#e6e8eb"


def label_colours(labels: Iterable[str]) -> dict[str, tuple[float, float, float, float]]:
    """Each label's colour, the same in every figure and on the live page, as RGBA in 0..1."""
    return {label: to_rgba(label_colour(label)) for label in sorted(set(labels))}


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
