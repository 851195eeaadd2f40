"""Style of the figures, which are PNG files."""

from io import BytesIO
from pathlib import Path

import matplotlib as mpl
import matplotlib.pyplot as plt
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from edgemap.runtime.frames.disk import make_folder, write_atomically

mpl.use("Agg")
mpl.rcParams["text.parse_math"] = False  # labels and ids come from files: a dollar sign is one

__all__ = ["Axes", "Figure", "plt", "save"]
INK, PAPER, GRID = "#22272e", "#ffffff", "#e6e8eb"


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
