"""The paper's Fig. 5: all sightings, the clusters they form, and the clusters' centres, with the robot's trajectory."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.lines import Line2D
from matplotlib.patches import Ellipse, Patch, Polygon
from numpy.typing import NDArray

from edgemap.geometry.grid.occupancy_grid import FREE, OCCUPIED, OccupancyGrid
from edgemap.geometry.grid.walls import walls_of
from edgemap.geometry.map_object import CHI2_95, MapObject
from edgemap.geometry.objects.edits import Zone
from edgemap.plots.style import (
    INK,
    Axes,
    PlotError,
    end_where_the_data_ends,
    floor_axes,
    label_colours,
    label_marker,
    legend_marks,
    plt,
    save,
    write_names,
)
from edgemap.runtime.frames.trajectory import Trajectory

FLOOR_RGBA, OBSTACLE_RGBA = (0.90, 0.93, 0.95, 1.0), (0.42, 0.46, 0.52, 1.0)
WAY, LONE, ZONE = "#7f8a97", "#8d96a1", "#5d667218"
MAXIMUM_DRAWN, MAXIMUM_NAMED, MAXIMUM_SIGHTINGS = 5000, 300, 5000  # a picture in some ten seconds; more is no picture
LONGEST_AXIS_M = 3.0  # an ellipse larger than this does not stretch the drawing


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
    trajectory: Trajectory | None = None,
    truth: Sequence[tuple[str, float, float]] = (),
    zones: Sequence[Zone] = (),
    grid: OccupancyGrid | None = None,
) -> Path:
    """Draw the three panels, or the centres alone where there are no sightings; the path.

    truth: label, x and y in metres of true objects, drawn as hollow marks over the centres. grid: the floor, drawn
    below everything.
    """
    if len(objects) > MAXIMUM_DRAWN:
        raise PlotError(f"{path}: {len(objects)} objects, at most {MAXIMUM_DRAWN} are drawn")
    count, sightings = len(sightings), sightings[:: 1 + len(sightings) // MAXIMUM_SIGHTINGS]
    labels = [item.label for item in objects] + [seen.label for seen in sightings] + [label for label, _, _ in truth]
    colours = label_colours(labels)
    panels = 3 if sightings else 1
    everything = _everything(objects, sightings, trajectory, truth, zones)
    if grid is not None:
        everything = np.concatenate([everything, *(grid.centres_m(grid.cells == value) for value in (FREE, OCCUPIED))])
    width, height = _panel_size(everything)
    figure, panels_of = plt.subplots(
        1, panels, figsize=(width * panels, height + 1.1), squeeze=False, sharex=True, sharey=True, layout="constrained"
    )
    axes = list(panels_of[0])
    for panel in axes:
        _floor(panel, grid)
        _zones(panel, zones)
        _trajectory(panel, trajectory)
    if sightings:
        _points(axes[0], sightings, colours)
        floor_axes(axes[0], f"(a) all {count} sightings", "map")
        _clusters(axes[1], sightings, objects, colours)
        floor_axes(axes[1], f"(b) {len(objects)} clusters", "map")
    _centres(axes[-1], objects, colours)
    for label, x_m, y_m in truth:
        axes[-1].plot(
            y_m, x_m, marker=label_marker(label), markersize=12, fillstyle="none", color=colours[label], zorder=3
        )
    floor_axes(axes[-1], ("(c) " if sightings else "") + "centres with 95 % ellipses", "map")
    end_where_the_data_ends(axes[-1], everything)
    figure.legend(
        handles=[*legend_marks(labels), *_legend_lines(objects, sightings, trajectory, truth, zones)],
        loc="outside lower center", ncols=max(2, int(width * panels / 1.6)), frameon=False, fontsize=9,
    )  # fmt: skip
    named = [item for item in objects if item.name or len(objects) <= MAXIMUM_NAMED][:MAXIMUM_NAMED]
    names = [(item.name or item.id, float(item.position_m[0]), float(item.position_m[1])) for item in named]
    middles = [(zone.name, np.mean(zone.corners_m, axis=0)) for zone in zones]
    names += [(name, float(place[0]), float(place[1])) for name, place in middles]
    write_names(figure, axes[-1], names)
    return save(figure, path)


def _everything(
    objects: Sequence[MapObject],
    sightings: Sequence[SeenAt],
    trajectory: Trajectory | None,
    truth: Sequence[tuple[str, float, float]],
    zones: Sequence[Zone],
) -> NDArray[np.float64]:
    """All points that are to be seen, (N, 2), the ends of ellipses among them."""
    points = [np.zeros((1, 2)), *(np.array(zone.corners_m) for zone in zones)]
    for item in objects:
        points.append(ellipse_ends(item.position_m, item.covariance_m2))
    points.append(np.array([(seen.x_m, seen.y_m) for seen in sightings]).reshape(-1, 2))
    points.append(np.array([(pose.x_m, pose.y_m) for pose in (trajectory.poses if trajectory else ())]).reshape(-1, 2))
    points.append(np.array([(x_m, y_m) for _, x_m, y_m in truth]).reshape(-1, 2))
    return np.concatenate(points)


def _panel_size(points: NDArray[np.float64]) -> tuple[float, float]:
    """Width and height in inches of one panel, shaped like what it shows."""
    up, across = np.ptp(points, axis=0) + 1.0
    return float(np.clip(6.0 * across / up, 3.2, 8.0)), float(np.clip(8.0 * up / across, 3.0, 6.0))


def _legend_lines(
    objects: Sequence[MapObject],
    sightings: Sequence[SeenAt],
    trajectory: Trajectory | None,
    truth: Sequence[tuple[str, float, float]],
    zones: Sequence[Zone],
) -> list[Line2D | Patch]:
    """What else is drawn, by name."""
    shown, found = {item.id for item in objects}, []
    hollow = {"linestyle": "", "fillstyle": "none", "markersize": 11}
    if objects:
        found.append(Line2D([], [], marker="o", color=WAY, label="95 % ellipse", **hollow))
    if trajectory is not None:
        found.append(Line2D([], [], color=WAY, linewidth=1.4, label="trajectory"))
        found.append(Line2D([], [], marker="^", linestyle="", color=INK, markersize=8, label="start"))
        found.append(Line2D([], [], marker="s", linestyle="", color=INK, markersize=6, label="end"))
    if any(seen.object_id not in shown for seen in sightings):
        found.append(Line2D([], [], marker="x", linestyle="", color=LONE, markersize=5, label="sighting of no object"))
    if truth:
        found.append(Line2D([], [], marker="s", color=INK, label="true place (mark of its class)", **hollow))
    if zones:
        found.append(Patch(facecolor=ZONE, edgecolor=INK, linewidth=0.8, label="zone"))
    return found


def _floor(axes: Axes, grid: OccupancyGrid | None) -> None:
    """Free floor light, obstacles dark, walls as lines; unknown is the background."""
    if grid is None:
        return
    rows, columns = grid.cells.shape
    picture = np.zeros((columns, rows, 4))
    picture[grid.cells.T == FREE], picture[grid.cells.T == OCCUPIED] = FLOOR_RGBA, OBSTACLE_RGBA
    low, high = np.array([grid.x_m, grid.y_m]), np.array([columns, rows]) * grid.cell_m
    extent = (low[1], low[1] + high[1], low[0], low[0] + high[0])
    axes.imshow(picture, origin="lower", extent=extent, interpolation="nearest", zorder=0.2, aspect="equal")
    for wall in walls_of(grid):
        (x0, y0), (x1, y1) = wall.from_m, wall.to_m
        axes.plot([y0, y1], [x0, x1], color=INK, linewidth=1.6, solid_capstyle="round", zorder=0.4)


def _zones(axes: Axes, zones: Sequence[Zone]) -> None:
    for zone in zones:
        corners = [(y_m, x_m) for x_m, y_m in zone.corners_m]
        axes.add_patch(Polygon(corners, facecolor=ZONE, edgecolor=INK, linewidth=0.8, zorder=0.5))


def _trajectory(axes: Axes, trajectory: Trajectory | None) -> None:
    if trajectory is None:
        return
    x = [pose.x_m for pose in trajectory.poses]
    y = [pose.y_m for pose in trajectory.poses]
    axes.plot(y, x, color=WAY, linewidth=1.4, zorder=1)
    axes.plot(y[0], x[0], marker="^", color=INK, markersize=8, zorder=3)
    axes.plot(y[-1], x[-1], marker="s", color=INK, markersize=6, zorder=3)


def _points(axes: Axes, sightings: Sequence[SeenAt], colours: dict) -> None:
    for label, colour in colours.items():
        mine = [seen for seen in sightings if seen.label == label]
        axes.scatter(
            [s.y_m for s in mine], [s.x_m for s in mine], s=9, color=colour, alpha=0.5, linewidths=0,
            marker=label_marker(label),
        )  # fmt: skip


def _clusters(axes: Axes, sightings: Sequence[SeenAt], objects: Sequence[MapObject], colours: dict) -> None:
    """Each object's sightings with lines to its centre; sightings of none are small grey crosses."""
    centre = {item.id: item.position_m for item in objects}
    for seen in sightings:
        if seen.object_id in centre:
            x_m, y_m = centre[seen.object_id]
            axes.plot([seen.y_m, y_m], [seen.x_m, x_m], color=colours[seen.label], linewidth=0.5, alpha=0.35)
        else:
            axes.plot(seen.y_m, seen.x_m, "x", color=LONE, markersize=3)
    for item in objects:
        axes.plot(*item.position_m[::-1], marker=label_marker(item.label), color=colours[item.label], markersize=6)


def _centres(axes: Axes, objects: Sequence[MapObject], colours: dict) -> None:
    for item in objects:
        x_m, y_m = item.position_m
        axes.add_patch(ellipse_patch(item.position_m, item.covariance_m2, colours[item.label]))
        axes.plot(y_m, x_m, marker=label_marker(item.label), color=colours[item.label], markersize=6, zorder=4)
    if not objects:
        axes.text(0.5, 0.5, "no objects", ha="center", va="center", transform=axes.transAxes, color=INK)


def ellipse_ends(position_m: NDArray[np.float64], covariance_m2: NDArray[np.float64]) -> NDArray[np.float64]:
    """Two corners (2, 2) of the box round the 95 % ellipse, no farther off than `LONGEST_AXIS_M`."""
    reach = np.minimum(np.sqrt(CHI2_95 * np.diag(covariance_m2)), LONGEST_AXIS_M)
    return position_m + np.array([reach, -reach])


def ellipse_patch(position_m: NDArray[np.float64], covariance_m2: NDArray[np.float64], colour: tuple) -> Ellipse:
    """The 95 % ellipse, in drawing axes (horizontal y, vertical x)."""
    values, vectors = np.linalg.eigh(covariance_m2[::-1, ::-1])
    width, height = 2.0 * np.sqrt(CHI2_95 * np.maximum(values, 0.0))
    angle_deg = float(np.degrees(np.arctan2(vectors[1, 0], vectors[0, 0])))
    return Ellipse(
        (float(position_m[1]), float(position_m[0])), width, height, angle=angle_deg, facecolor=(*colour[:3], 0.18),
        edgecolor=colour, linewidth=1.0, zorder=2,
    )  # fmt: skip
