"""Style of the figures: colours by label; figures as PNG files."""

from collections.abc import Iterable
from io import BytesIO
from pathlib import Path

import matplotlib as mpl
import matplotlib.pyplot as plt
from matplotlib.axes import Axes
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure

from edgemap.runtime.frames.colours import label_colour
from edgemap.runtime.frames.disk import make_folder, write_atomically

mpl.use("Agg")
mpl.rcParams["text.parse_math"] = False  # labels and ids come from files: a dollar sign is one

__all__ = ["Axes", "Figure", "label_colours", "plt", "save"]
INK, PAPER, GRID = "#22272e", "#ffffff", "#e6e8eb"


def label_colours(labels: Iterable[str]) -> dict[str, tuple[float, float, float, float]]:
    """Each label's colour, the same in every figure and on the live page, as RGBA in 0..1."""
    return {label: to_rgba(label_colour(label)) for label in sorted(set(labels))}


def save(figure: Figure, path: Path) -> Path:
    """Write a figure as PNG, making its folder; the path. Raises DiskError."""
    try:
        drawn = BytesIO()
        figure.savefig(drawn, format="png", dpi=130, facecolor=PAPER, bbox_inches="tight")
    finally:
        plt.close(figure)
    make_folder(path.parent)
    write_atomically(path, drawn.getvalue())  # a link in a folder of a stranger's is replaced, not written through
    return path
