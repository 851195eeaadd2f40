"""The paper's Fig. 4: one picture, the distances found in it, and the same on a 2-D map; plus the mount's grid."""

from pathlib import Path

import cv2
import numpy as np
from matplotlib.patches import Ellipse
from numpy.typing import NDArray

from edgemap.geometry.camera.floor import FloorCamera
from edgemap.geometry.map_object import CHI2_95
from edgemap.geometry.observations.detections import Detections
from edgemap.geometry.observations.sighting import Sighting
from edgemap.plots.style import (
    INK,
    Axes,
    end_where_the_data_ends,
    floor_axes,
    label_colours,
    label_marker,
    plt,
    save,
    write_names,
)
from edgemap.runtime.step.overlay import draw_detections, draw_floor_grid

LONGEST_AXIS_M = 3.0  # an ellipse larger than this does not stretch the drawing


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
    places = [(sighting.label, sighting.position_base_m) for sighting in sightings]
    names = [(label, float(place[0]), float(place[1])) for label, place in places]
    write_names(figure, right, [("robot", 0.0, 0.0), *names])
    return save(figure, path)


def _distances(axes: Axes, sightings: list[Sighting]) -> None:
    """Horizontal bars, nearest on top."""
    ordered = sorted(sightings, key=lambda sighting: -sighting.distance_m)
    colours = label_colours(sighting.label for sighting in sightings)
    rows = np.arange(len(ordered))
    errors = [np.sqrt(np.linalg.eigvalsh(s.covariance_m2 + s.shared_m2)[-1]) for s in ordered]
    axes.barh(rows, [s.distance_m for s in ordered], xerr=errors, color=[colours[s.label] for s in ordered], ecolor=INK)
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
    colours = label_colours(sighting.label for sighting in sightings)
    axes.plot(0, 0, marker="^", markersize=11, color=INK)
    points = [np.array([[-0.3, -1.0], [1.0, 1.0]])]
    for sighting in sightings:
        covariance, colour = sighting.covariance_m2 + sighting.shared_m2, colours[sighting.label]
        axes.add_patch(_ellipse(sighting.position_base_m, covariance, colour))
        axes.plot(*sighting.position_base_m[::-1], marker=label_marker(sighting.label), markersize=7, color=colour)
        reach = np.minimum(np.sqrt(CHI2_95 * np.diag(covariance)), LONGEST_AXIS_M)
        points.append(sighting.position_base_m + np.array([reach, -reach]))
    floor_axes(axes, "(c) 2-D map with 95 % ellipses", "base")
    end_where_the_data_ends(axes, np.concatenate(points))


def _ellipse(position_m: NDArray[np.float64], covariance_m2: NDArray[np.float64], colour: tuple) -> Ellipse:
    """The 95 % ellipse, in drawing axes (horizontal y, vertical x)."""
    values, vectors = np.linalg.eigh(covariance_m2[::-1, ::-1])
    width, height = 2.0 * np.sqrt(CHI2_95 * np.maximum(values, 0.0))
    angle_deg = float(np.degrees(np.arctan2(vectors[1, 0], vectors[0, 0])))
    return Ellipse(
        (float(position_m[1]), float(position_m[0])), width, height, angle=angle_deg, facecolor=(*colour[:3], 0.18),
        edgecolor=colour, linewidth=1.0, zorder=2,
    )  # fmt: skip
