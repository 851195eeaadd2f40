"""The paper's Fig. 5: all sightings, the clusters they form, and the clusters' centres, with the robot's trajectory."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.lines import Line2D
from matplotlib.patches import Ellipse
from numpy.typing import NDArray

from edgemap.geometry.objects.map_object import CHI2_95, MapObject
from edgemap.plots.style import INK, Axes, floor_axes, label_colours, plt, save
from edgemap.runtime.trajectory import Trajectory


@dataclass(frozen=True, slots=True)
class SeenAt:
    """A sighting as drawn: label, id of its object ('' where it joined none on the map), x and y in metres."""

    label: str
    object_id: str
    x_m: float
    y_m: float


def plot_map(
    path: Path,
    objects: Sequence[MapObject],
    sightings: Sequence[SeenAt] = (),
    way: Trajectory | None = None,
    truth: Sequence[tuple[str, float, float]] = (),
) -> Path:
    """Draw the three panels, or the centres alone where no sightings are known; the path.

    truth: label, x and y in metres of what really stands there, drawn as hollow squares over the centres.
    """
    labels = [item.label for item in objects] + [seen.label for seen in sightings] + [label for label, _, _ in truth]
    colours = label_colours(labels)
    panels = 3 if sightings else 1
    width, height = _panel_size(objects, sightings, way)
    figure, grid = plt.subplots(
        1, panels, figsize=(width * panels, height + 0.8), squeeze=False, sharex=True, sharey=True, layout="constrained"
    )
    axes = list(grid[0])
    for panel in axes:
        _way(panel, way)
    if sightings:
        _points(axes[0], sightings, colours)
        floor_axes(axes[0], f"(a) all {len(sightings)} sightings", "map")
        _clusters(axes[1], sightings, objects, colours)
        floor_axes(axes[1], f"(b) {len(objects)} clusters", "map")
    _centres(axes[-1], objects, colours)
    for label, x_m, y_m in truth:
        axes[-1].plot(y_m, x_m, "s", markersize=11, fillstyle="none", color=colours[label], zorder=3)
    floor_axes(axes[-1], ("(c) " if sightings else "") + "centres with 95 % ellipses", "map")
    handles = [Line2D([], [], marker="o", linestyle="", color=colour, label=label) for label, colour in colours.items()]
    if handles:
        figure.legend(
            handles=handles, loc="outside lower center", ncols=min(8, len(handles)), frameon=False, fontsize=9
        )
    return save(figure, path)


def _panel_size(
    objects: Sequence[MapObject], sightings: Sequence[SeenAt], way: Trajectory | None
) -> tuple[float, float]:
    """Width and height in inches of one panel, shaped like what it shows."""
    x = [float(item.position_m[0]) for item in objects] + [seen.x_m for seen in sightings]
    y = [float(item.position_m[1]) for item in objects] + [seen.y_m for seen in sightings]
    poses = way.poses if way else ()
    up = np.ptp([0.0, *x, *(pose.x_m for pose in poses)]) + 1.0
    across = np.ptp([0.0, *y, *(pose.y_m for pose in poses)]) + 1.0
    return float(np.clip(6.0 * across / up, 3.2, 8.0)), float(np.clip(8.0 * up / across, 3.0, 6.0))


def _way(axes: Axes, way: Trajectory | None) -> None:
    if way is None:
        return
    x = [pose.x_m for pose in way.poses]
    y = [pose.y_m for pose in way.poses]
    axes.plot(y, x, color="#9aa4b0", linewidth=1.4, zorder=1)
    axes.plot(y[0], x[0], marker="^", color=INK, markersize=8, zorder=3)
    axes.plot(y[-1], x[-1], marker="s", color=INK, markersize=6, zorder=3)


def _points(axes: Axes, sightings: Sequence[SeenAt], colours: dict) -> None:
    for label, colour in colours.items():
        mine = [seen for seen in sightings if seen.label == label]
        axes.scatter([s.y_m for s in mine], [s.x_m for s in mine], s=9, color=colour, alpha=0.5, linewidths=0)


def _clusters(axes: Axes, sightings: Sequence[SeenAt], objects: Sequence[MapObject], colours: dict) -> None:
    """Each object's sightings with lines to its centre; sightings of none are small grey crosses."""
    centre = {item.id: item.position_m for item in objects}
    for seen in sightings:
        if seen.object_id in centre:
            x_m, y_m = centre[seen.object_id]
            axes.plot([seen.y_m, y_m], [seen.x_m, x_m], color=colours[seen.label], linewidth=0.5, alpha=0.35)
        else:
            axes.plot(seen.y_m, seen.x_m, "x", color="#b8bec6", markersize=3)
    for item in objects:
        axes.plot(item.position_m[1], item.position_m[0], "o", color=colours[item.label], markersize=5)


def _centres(axes: Axes, objects: Sequence[MapObject], colours: dict) -> None:
    for item in objects:
        x_m, y_m = item.position_m
        axes.add_patch(_ellipse(item.position_m, item.covariance_m2, colours[item.label]))
        axes.plot(y_m, x_m, "o", color=colours[item.label], markersize=5, zorder=4)
        axes.annotate(item.id, (y_m, x_m), textcoords="offset points", xytext=(6, 5), fontsize=8, color=INK, zorder=5)
    if not objects:
        axes.text(0.5, 0.5, "no objects", ha="center", va="center", transform=axes.transAxes, color=INK)


def _ellipse(position_m: NDArray[np.float64], covariance_m2: NDArray[np.float64], colour: tuple) -> Ellipse:
    """The 95 % ellipse, in drawing axes (horizontal y, vertical x)."""
    values, vectors = np.linalg.eigh(covariance_m2[::-1, ::-1])
    width, height = 2.0 * np.sqrt(CHI2_95 * np.maximum(values, 0.0))
    angle_deg = float(np.degrees(np.arctan2(vectors[1, 0], vectors[0, 0])))
    return Ellipse(
        (float(position_m[1]), float(position_m[0])), width, height, angle=angle_deg, facecolor=(*colour[:3], 0.18),
        edgecolor=colour, linewidth=1.0, zorder=2,
    )  # fmt: skip
