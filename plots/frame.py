"""The paper's Fig. 4: one picture, the distances found in it, and the same on a 2-D map; plus the mount's grid."""

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from edgemap.geometry.camera.floor import FloorCamera
from edgemap.geometry.map_object import MapObject
from edgemap.geometry.observations.detections import Detections
from edgemap.geometry.observations.sighting import Sighting
from edgemap.geometry.se2 import SE2
from edgemap.plots.style import INK, Axes, plt, save
from edgemap.runtime.frames.colours import label_mark
from edgemap.runtime.outputs.map_formats.drawing import DrawnMap, map_picture
from edgemap.runtime.step.overlay import draw_detections, draw_floor_grid


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
    colours = [label_mark(s.label).colour for s in ordered]
    rows = np.arange(len(ordered))
    errors = [np.sqrt(np.linalg.eigvalsh(s.covariance_m2 + s.shared_m2)[-1]) for s in ordered]
    axes.barh(rows, [s.distance_m for s in ordered], xerr=errors, color=colours, ecolor=INK)
    axes.set_yticks(rows, [f"{s.label}\n{s.width_m:.2f} x {s.height_m:.2f} m" for s in ordered])
    for row, (sighting, error) in enumerate(zip(ordered, errors, strict=True)):
        text = f" {sighting.distance_m:.2f} ± {error:.2f} m"
        axes.text(sighting.distance_m + error, row, text, va="center", fontsize=8, color=INK)
    axes.set_title("(b) distance from the lens (width x height)", fontsize=11, color=INK, loc="left")
    axes.set_xlabel("m, one sigma", fontsize=9)
    axes.spines[["top", "right"]].set_visible(False)
    if ordered:
        farthest_m = max(s.distance_m + error for s, error in zip(ordered, errors, strict=True))
        axes.set_xlim(0.0, 1.3 * farthest_m)  # the text stands behind the bar
        axes.set_ylim(-0.6, len(ordered) - 0.4)
    else:
        axes.text(0.5, 0.5, "nothing on the floor", ha="center", va="center", transform=axes.transAxes)


def _map(axes: Axes, sightings: list[Sighting]) -> None:
    """Objects from above with 95 % ellipses, robot at the origin."""
    objects = [
        MapObject(f"{one.label}-{number}", one.label, one.position_base_m, one.covariance_m2 + one.shared_m2,
                  one.width_m, one.height_m, 1, one.score, one.stamp_s, one.stamp_s, name=one.label, confirmed=True)
        for number, one in enumerate(sightings, start=1)
    ]  # fmt: skip
    axes.imshow(cv2.cvtColor(map_picture(DrawnMap(objects, (SE2(),))), cv2.COLOR_BGR2RGB))
    axes.set_title("(c) 2-D map of the base frame", fontsize=11, color=INK, loc="left")
    axes.axis("off")
