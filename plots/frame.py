"""The paper's Fig. 4: one picture, the distances found in it, and the same on a 2-D map; plus the mount's grid."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from edgemap.geometry.camera.floor import FloorCamera
from edgemap.geometry.observations.detections import Detections
from edgemap.geometry.observations.sighting import Sighting
from edgemap.plots.style import INK, Axes, floor_axes, label_colours, plt, save
from edgemap.runtime.overlay import draw_detections, draw_floor_grid


def plot_frame(
    path: Path, image: NDArray[np.uint8], detections: Detections, sightings: list[Sighting], camera: FloorCamera
) -> Path:
    """Draw picture (boxes floor or not, horizon and metre grid), distances, and map in the base frame; the path."""
    figure, (left, middle, right) = plt.subplots(
        1, 3, figsize=(16, 5), gridspec_kw={"width_ratios": [1.5, 1.0, 1.0]}, layout="constrained"
    )
    picture = draw_detections(draw_floor_grid(image, camera), detections, sightings)
    left.imshow(cv2.cvtColor(picture, cv2.COLOR_BGR2RGB))
    left.set_title("(a) boxes on the floor (green) and not (grey), horizon, metre grid", fontsize=11, loc="left")
    left.axis("off")
    _distances(middle, sightings)
    _map(right, sightings)
    return save(figure, path)


def _distances(axes: Axes, sightings: list[Sighting]) -> None:
    """Horizontal bars, nearest on top."""
    ordered = sorted(sightings, key=lambda sighting: -sighting.distance_m)
    colours = label_colours(sighting.label for sighting in sightings)
    rows = np.arange(len(ordered))
    errors = [np.sqrt(np.linalg.eigvalsh(s.covariance_m2 + s.shared_m2)[-1]) for s in ordered]
    axes.barh(rows, [s.distance_m for s in ordered], xerr=errors, color=[colours[s.label] for s in ordered], ecolor=INK)
    axes.set_ylim(-0.8, max(len(ordered), 4) - 0.2)
    axes.set_yticks(rows, [s.label for s in ordered])
    for row, sighting in enumerate(ordered):
        size = f"{sighting.distance_m:.2f} m   ({sighting.width_m:.2f} x {sighting.height_m:.2f} m)"
        axes.text(0.03, row, size, va="center", fontsize=8, color="white")
    axes.set_title("(b) distance from the lens (width x height)", fontsize=11, color=INK, loc="left")
    axes.set_xlabel("m, one sigma", fontsize=9)
    axes.spines[["top", "right"]].set_visible(False)
    if not ordered:
        axes.text(0.5, 0.5, "nothing on the floor", ha="center", va="center", transform=axes.transAxes)


def _map(axes: Axes, sightings: list[Sighting]) -> None:
    """Objects from above, robot at the origin."""
    colours = label_colours(sighting.label for sighting in sightings)
    axes.plot(0, 0, marker="^", markersize=11, color=INK)
    axes.annotate("robot", (0, 0), textcoords="offset points", xytext=(9, -3), fontsize=8)
    for sighting in sightings:
        x_m, y_m = sighting.position_base_m
        axes.plot(y_m, x_m, "o", color=colours[sighting.label])
        axes.annotate(sighting.label, (y_m, x_m), textcoords="offset points", xytext=(7, 4), fontsize=8)
    reach = max([1.0, *(float(np.abs(s.position_base_m).max()) for s in sightings)]) * 1.15
    axes.set_xlim(reach * 0.7, -reach * 0.7)
    axes.set_ylim(-0.15 * reach, reach)
    floor_axes(axes, "(c) 2-D map", "base")
