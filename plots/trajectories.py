"""The paper's Fig. 7: an odometry's trajectory over the true one."""

from collections.abc import Mapping, Sequence
from itertools import cycle
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from edgemap.evaluation.trajectory import path_m
from edgemap.geometry.se2 import SE2
from edgemap.plots.style import GRID, INK, plt, save

TRUTH = "#9aa4b0"
COLOURS = ("#d1495b", "#00798c", "#c98a1b", "#6a4c93", "#3d7a3a")


def plot_ways(path: Path, title: str, true: Sequence[SE2], estimated: Mapping[str, Sequence[SE2]]) -> Path:
    """Draw ways from above from their common start, and below how far apart they are along the way; the path.

    true, and each of estimated (by its odometry's name): poses of the same frames.
    """
    origin = true[0].inverse()
    wanted = _places([origin @ pose for pose in true])
    ways = {name: _places([poses[0].inverse() @ pose for pose in poses]) for name, poses in estimated.items()}
    width, height = _size(np.vstack([wanted, *ways.values()]))
    figure, (floor, apart) = plt.subplots(
        2, 1, figsize=(width, height + 2.0), gridspec_kw={"height_ratios": [height, 1.5]}, layout="constrained"
    )
    gone_m = path_m(true)
    floor.plot(wanted[:, 1], wanted[:, 0], color=TRUTH, linewidth=3.5, label="true trajectory", solid_capstyle="round")
    for (name, places), colour in zip(ways.items(), cycle(COLOURS), strict=False):
        floor.plot(places[:, 1], places[:, 0], color=colour, linewidth=1.5, label=name)
        floor.plot(places[-1, 1], places[-1, 0], "s", color=colour, markersize=6)
        apart.plot(gone_m, np.linalg.norm(places - wanted, axis=1), color=colour, linewidth=1.5)
    floor.plot(wanted[-1, 1], wanted[-1, 0], "s", color=TRUTH, markersize=9, zorder=1)
    floor.plot(0.0, 0.0, "^", color=INK, markersize=9, label="start", linestyle="")
    floor.plot([], [], "s", color=INK, markersize=6, label="end", linestyle="")
    for axes, across, up in (
        (floor, "y left (m), start frame", "x forward (m), start frame"),
        (apart, "path length (m)", "apart (m)"),
    ):
        axes.set_xlabel(across, fontsize=9)
        axes.set_ylabel(up, fontsize=9)
        axes.grid(color=GRID, linewidth=0.8)
        axes.set_axisbelow(True)
        axes.tick_params(labelsize=8)
        axes.spines[["top", "right"]].set_visible(False)
    title = f"{title}: {gone_m[-1]:.1f} m in {len(true)} frames"
    floor.set_title(title, fontsize=11, color=INK, loc="left")
    floor.set_aspect("equal", adjustable="box")
    floor.invert_xaxis()
    apart.set(xlim=(0.0, None), ylim=(0.0, None))
    figure.legend(*floor.get_legend_handles_labels(), loc="outside lower center", ncols=6, frameon=False, fontsize=9)
    return save(figure, path)


def _places(poses: Sequence[SE2]) -> NDArray[np.float64]:
    return np.array([(pose.x_m, pose.y_m) for pose in poses])


def _size(places: NDArray[np.float64]) -> tuple[float, float]:
    """Width and height in inches of the view from above, shaped like what it shows."""
    up, across = np.ptp(places, axis=0) + 0.05 * np.ptp(places) + 1e-3
    return float(np.clip(6.0 * across / up, 4.5, 8.5)), float(np.clip(7.0 * up / across, 3.0, 6.5))
