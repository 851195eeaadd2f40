"""The map from above as a picture, SVG or PNG: x forward is up, y left is left, one scale for both."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from edgemap.geometry.errors import MapError
from edgemap.geometry.grid.occupancy_grid import FREE, OCCUPIED, UNKNOWN, OccupancyGrid
from edgemap.geometry.grid.rooms import Door, Room
from edgemap.geometry.grid.walls import Wall, walls_of
from edgemap.geometry.map_object import MapObject, ellipse_95, outline_m, radius_m, reach_m
from edgemap.geometry.objects.annotations import Zone
from edgemap.geometry.objects.rooms import title_of
from edgemap.geometry.se2 import SE2
from edgemap.runtime.frames.colours import SHAPES, label_mark
from edgemap.runtime.frames.disk import make_folder, write_atomically
from edgemap.runtime.frames.frame import png
from edgemap.runtime.outputs.map_formats.grid import MARGIN_M
from edgemap.runtime.outputs.map_formats.shapes import (
    INK,
    MAXIMUM_SHAPES,
    PAPER,
    Item,
    Points,
    Raster,
    Shape,
    Text,
    bgr,
    picture_of,
    place_labels,
    svg_of,
)
from edgemap.runtime.outputs.sightings_file import SeenRecord
from edgemap.runtime.outputs.verdict.verdict import is_doubtful

WIDEST_PX, TALLEST_PX, TITLE_PX = 960.0, 720.0, 28.0  # of one panel
GRID, MUTED, PATH, LONE = "#e6e8eb", "#5d6672", "#7f8a97", "#8d96a1"
FLOOR_COLOUR, OBSTACLE_COLOUR = "#e6edf2", "#6b7585"


@dataclass(frozen=True, slots=True)
class DrawnMap:
    """What is drawn, map frame. poses: the trajectory. sightings: drawn in two panels more. truth: label, x and y in
    metres of true objects. grid: the floor below everything."""

    objects: Sequence[MapObject]
    poses: Sequence[SE2] = ()
    sightings: Sequence[SeenRecord] = ()
    truth: Sequence[tuple[str, float, float]] = ()
    zones: Sequence[Zone] = ()
    grid: OccupancyGrid | None = None
    rooms: Sequence[Room] = ()
    doors: Sequence[Door] = ()


@dataclass(frozen=True, slots=True)
class Sheet:
    """One panel: the map position of its upper left corner, m, px per metre, and its size."""

    top_x_m: float
    left_y_m: float
    px_per_m: float
    width_px: float
    height_px: float

    def at(self, points_m: ArrayLike) -> Points:
        """Map positions (..., 2) in metres to px (right, down)."""
        points = np.asarray(points_m, dtype=np.float64)
        return np.stack([self.left_y_m - points[..., 1], self.top_x_m - points[..., 0]], axis=-1) * self.px_per_m


def draw_map(path: Path, drawn: DrawnMap) -> Path:
    """Writes the drawing, as PNG or SVG by the path's ending, and makes its folder; returns the path. Raises MapError
    for another ending and for more than `MAXIMUM_SHAPES` objects, DiskError where it cannot be written."""
    kind = path.suffix.lower()
    if kind not in (".png", ".svg"):
        raise MapError(f"{path}: pictures are .png or .svg")
    if len(drawn.objects) > MAXIMUM_SHAPES:
        raise MapError(f"{path}: {len(drawn.objects)} objects, at most {MAXIMUM_SHAPES} are drawn")
    make_folder(path.parent)
    write_atomically(path, map_svg(drawn) if kind == ".svg" else png(map_picture(drawn)))
    return path


def map_picture(drawn: DrawnMap) -> NDArray[np.uint8]:
    """The drawing as a BGR picture."""
    return picture_of(*_panels(drawn))


def map_svg(drawn: DrawnMap) -> str:
    """The drawing as SVG text."""
    return svg_of(*_panels(drawn), f"map from above with {len(drawn.objects)} objects")


def _panels(drawn: DrawnMap) -> tuple[list[Item], float, float]:
    """All shapes of the drawing, its width and its height. Source of the three panels: the paper's Fig. 5."""
    sheet, objects = _sheet(drawn), drawn.objects
    below = [*_floor(sheet, drawn), *_path(sheet, drawn.poses)]
    hollow = sum(map(is_doubtful, objects))
    title = f"{len(objects)} objects with 95 % ellipses" + (f", {hollow} doubtful (hollow)" if hollow else "")
    panels = [(title, _centres(sheet, drawn))]
    if drawn.sightings:
        seen = drawn.sightings[:: 1 + len(drawn.sightings) // MAXIMUM_SHAPES]
        dots = [Shape(sheet.at(one.map_m) + _circle(2.5), label_mark(one.label).colour, opacity=0.5) for one in seen]
        panels = [
            (f"(a) all {len(drawn.sightings)} sightings", dots),
            (f"(b) {len(objects)} clusters", _clusters(sheet, seen, objects)),
            (f"(c) {panels[0][0]}", panels[0][1]),
        ]
    items: list[Item] = []
    for number, (title, content) in enumerate(panels):
        right = number * (sheet.width_px + 2.0 * TITLE_PX)
        items += [_moved(item, right, TITLE_PX) for item in (*below, *content)]
        items.append(Text(title, right + 4.0, 18.0))
    return items, right + sheet.width_px, sheet.height_px + TITLE_PX


def _moved(item: Item, right: float, down: float) -> Item:
    if isinstance(item, Shape):
        return replace(item, points=item.points + (right, down))
    return replace(item, x=item.x + right, y=item.y + down)


def _sheet(drawn: DrawnMap) -> Sheet:
    """A panel on which everything has room."""
    points = [np.zeros((1, 2)), *(np.array(area.corners_m) for area in (*drawn.zones, *drawn.rooms))]
    points.append(np.array([[pose.x_m, pose.y_m] for pose in drawn.poses]).reshape(-1, 2))
    points.append(np.array([seen.map_m for seen in drawn.sightings]).reshape(-1, 2))
    points.append(np.array([place for _, *place in drawn.truth]).reshape(-1, 2))
    if drawn.grid is not None and (drawn.grid.cells != UNKNOWN).any():
        points.append(drawn.grid.centres_m(drawn.grid.cells != UNKNOWN))
    for item in drawn.objects:
        ellipse_m = 0.0 if is_doubtful(item) else min(ellipse_95(item.covariance_m2)[0], 3.0)  # a larger one is cut
        reach = max(reach_m(item), ellipse_m)
        points.append(item.position_m + reach * np.array([[1, 1], [-1, -1]]))
    every = np.concatenate(points)
    low, high = every.min(axis=0) - MARGIN_M, every.max(axis=0) + MARGIN_M
    deep_m, wide_m = np.maximum(high - low, 3.0)
    px_per_m = min(WIDEST_PX / wide_m, TALLEST_PX / deep_m)
    wide_m, deep_m = max(wide_m, 0.4 * WIDEST_PX / px_per_m), max(deep_m, 0.35 * WIDEST_PX / px_per_m)
    top, left = (high + low) / 2.0 + np.array([deep_m, wide_m]) / 2.0
    return Sheet(float(top), float(left), float(px_per_m), float(wide_m * px_per_m), float(deep_m * px_per_m))


def _floor(sheet: Sheet, drawn: DrawnMap) -> list[Item]:
    """The observed floor with its walls, the metre grid with its numbers, rooms, doors as gaps, and zones."""
    items: list[Item] = []
    if (grid := drawn.grid) is not None:
        rows, columns = grid.cells.shape
        picture = np.zeros((columns, rows, 4), np.uint8)
        turned = grid.cells.T[::-1, ::-1]  # x up, y to the left
        for value, colour in ((FREE, FLOOR_COLOUR), (OCCUPIED, OBSTACLE_COLOUR)):
            picture[turned == value] = (*bgr(colour), 255)
        (x, y), scale = sheet.at([grid.x_m + columns * grid.cell_m, grid.y_m + rows * grid.cell_m]), grid.cell_m
        scale *= sheet.px_per_m
        items.append(Raster(picture, float(x), float(y), rows * scale, columns * scale))
    items += _metre_grid(sheet)
    if grid is not None:
        items += [_line(sheet, wall, INK, 2.5) for wall in walls_of(grid)]
    items += [
        Shape(sheet.at(room.corners_m), label_mark(title_of(room)).colour, INK, opacity=0.12) for room in drawn.rooms
    ]
    items += [_line(sheet, door, PAPER, 5.0) for door in drawn.doors]
    for corners in (sheet.at(zone.corners_m) for zone in drawn.zones):
        items += [Shape(corners, MUTED, opacity=0.1), Shape(corners, stroke=INK, width=1.0)]
    return items


def _line(sheet: Sheet, one: Wall | Door, colour: str, width_px: float) -> Shape:
    return Shape(sheet.at([one.from_m, one.to_m]), stroke=colour, width=width_px, closed=False)


def _metre_grid(sheet: Sheet) -> list[Item]:
    least_m = 56.0 / sheet.px_per_m  # between two lines
    power_m = 10.0 ** math.floor(math.log10(least_m))
    step = next(power_m * number for number in (1, 2, 5, 10) if power_m * number >= least_m)
    wide, deep, scale = sheet.width_px, sheet.height_px, sheet.px_per_m
    items: list[Item] = []
    for n in range(math.ceil((sheet.top_x_m - deep / scale) / step), math.floor(sheet.top_x_m / step) + 1):
        y = float(sheet.at([n * step, 0.0])[1])
        items.append(Shape(np.array([[0.0, y], [wide, y]]), stroke=GRID, width=1.0 + (n == 0), closed=False))
        if 24 < y < deep - 24:
            items.append(Text(f"{n * step:g}", 4.0, y - 4.0, colour=MUTED))
    for n in range(math.ceil((sheet.left_y_m - wide / scale) / step), math.floor(sheet.left_y_m / step) + 1):
        x = float(sheet.at([0.0, n * step])[0])
        items.append(Shape(np.array([[x, 0.0], [x, deep]]), stroke=GRID, width=1.0 + (n == 0), closed=False))
        if 30 < x < wide - 190:
            items.append(Text(f"{n * step:g}", x + 4.0, deep - 6.0, colour=MUTED))
    items.append(Text("x forward (up), y left, m", wide - 6.0, deep - 6.0, "end", MUTED))
    return items


def _path(sheet: Sheet, poses: Sequence[SE2]) -> list[Item]:
    """The trajectory from a circle to an arrow."""
    if not poses:
        return []
    points = sheet.at([[pose.x_m, pose.y_m] for pose in poses])
    thin = points[:: 1 + len(points) // MAXIMUM_SHAPES]
    arrow = [[0.0, -12.0], [8.5, 9.0], [0.0, 4.5], [-8.5, 9.0]] @ SE2(yaw_rad=poses[-1].yaw_rad).rotation()
    return [
        Shape(np.vstack([thin, points[-1:]]), stroke=PATH, width=2.0, closed=False),
        Shape(points[0] + _circle(6.0), PAPER, INK),
        Shape(points[-1] + arrow, INK, PAPER),
    ]


def _centres(sheet: Sheet, drawn: DrawnMap) -> list[Item]:
    """Objects with the floor that they take, 95 % ellipse and name; of doubtful objects the hollow mark alone."""
    items: list[Item] = []
    for item in sorted(drawn.objects, key=radius_m, reverse=True):  # small ones on top
        at, colour = sheet.at(item.position_m), label_mark(item.label).colour
        if not is_doubtful(item):
            items.append(Shape(sheet.at(outline_m(item)), colour, opacity=0.2))
            items.append(Shape(at + _ellipse(item) * sheet.px_per_m, stroke=colour, width=1.0))
    for label, *place in drawn.truth:
        items.append(Shape(sheet.at(place) + _mark(label, 9.0), stroke=label_mark(label).colour))
    items += [_spot(sheet, item, is_doubtful(item)) for item in drawn.objects]
    named = [(item.name or item.id, item.position_m) for item in drawn.objects]
    named += [(zone.name, np.mean(zone.corners_m, axis=0)) for zone in drawn.zones]
    named += [(title_of(room), room.centre_m) for room in drawn.rooms]
    spots = [(name, *sheet.at(place).tolist()) for name, place in named]
    placed = place_labels(spots, sheet.width_px, sheet.height_px)
    items += [Text(name, *place) for (name, _), place in zip(named, placed, strict=True)]
    if not drawn.objects:
        items.append(Text("no objects", sheet.width_px / 2.0, sheet.height_px / 2.0, "middle"))
    return items


def _clusters(sheet: Sheet, sightings: Sequence[SeenRecord], objects: Sequence[MapObject]) -> list[Item]:
    """Each sighting with a line to its object's centre; a sighting of none is a small hollow circle."""
    centres = {item.id: item.position_m for item in objects}
    items: list[Item] = []
    for seen in sightings:
        if (centre := centres.get(seen.object)) is None:
            items.append(Shape(sheet.at(seen.map_m) + _circle(2.5), stroke=LONE, width=1.0))
        else:
            ends = sheet.at([seen.map_m, tuple(centre)])
            items.append(Shape(ends, stroke=label_mark(seen.label).colour, opacity=0.35, width=0.5, closed=False))
    return items + [_spot(sheet, item) for item in objects]


def _spot(sheet: Sheet, item: MapObject, hollow: bool = False) -> Shape:
    """The mark at an object's position."""
    colour, corners = label_mark(item.label).colour, sheet.at(item.position_m) + _mark(item.label, 5.0)
    return Shape(corners, PAPER, colour) if hollow else Shape(corners, colour, PAPER)


def _mark(label: str, radius_px: float) -> Points:
    """The corners of a label's mark about its centre, px."""
    corners = SHAPES[label_mark(label).shape]
    return radius_px * np.array(corners) if corners else _circle(radius_px)


def _circle(radius_px: float, corners: int = 24) -> Points:
    angle = np.linspace(0.0, 2.0 * np.pi, corners, endpoint=False)
    return radius_px * np.column_stack([np.cos(angle), np.sin(angle)])


def _ellipse(item: MapObject) -> Points:
    """The 95 % ellipse about its centre, (48, 2), m, right and down."""
    long, short, yaw = ellipse_95(item.covariance_m2)
    x, y = SE2(yaw_rad=yaw).apply(_circle(1.0, 48) * (long, short)).T
    return np.column_stack([-y, -x])
