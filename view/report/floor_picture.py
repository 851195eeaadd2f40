"""The sheet that drawings of the map share; on it the observed floor: a picture of a pixel a cell, walls as lines."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from edgemap.geometry.grid.occupancy_grid import FREE, OCCUPIED, OccupancyGrid
from edgemap.geometry.grid.walls import walls_of
from edgemap.runtime.frames.frame import png
from edgemap.view.report.markup import Markup, data_uri, el, joined

Points = NDArray[np.float64]
# Blue, green, red, opacity: on light and on dark paper.
FREE_BGRA, OBSTACLE_BGRA = (170, 140, 110, 46), (140, 120, 105, 200)


@dataclass(frozen=True, slots=True)
class Sheet:
    """Origin and scale of a drawing: its corner in the map, m, and px per metre."""

    top_x_m: float
    left_y_m: float
    px_per_m: float
    width_px: float
    height_px: float

    def at(self, points_m: ArrayLike) -> Points:
        """Map positions (..., 2) in metres to drawing positions (right, down)."""
        points = np.asarray(points_m, dtype=np.float64)
        return np.stack([self.left_y_m - points[..., 1], self.top_x_m - points[..., 0]], axis=-1) * self.px_per_m


def observed_floor(sheet: Sheet, grid: OccupancyGrid) -> Markup:
    """Draws the grid's free floor, obstacles and walls as SVG elements; unknown cells stay white."""
    rows, columns = grid.cells.shape
    picture = np.zeros((columns, rows, 4), np.uint8)
    turned = grid.cells.T[::-1, ::-1]  # x up, y to the left
    picture[turned == FREE], picture[turned == OCCUPIED] = FREE_BGRA, OBSTACLE_BGRA
    x, y = sheet.at([grid.x_m + columns * grid.cell_m, grid.y_m + rows * grid.cell_m])
    scale = grid.cell_m * sheet.px_per_m
    lines = []
    for wall in walls_of(grid):
        (x1, y1), (x2, y2) = sheet.at([wall.from_m, wall.to_m])
        lines.append(el("line", x1=x1, y1=y1, x2=x2, y2=y2))
    image = el(
        "image",
        href=data_uri(png(picture), "image/png"),
        x=x,
        y=y,
        width=rows * scale,
        height=columns * scale,
        preserveAspectRatio="none",
        class_="seen",
    )
    return joined(image, el("g", lines, class_="walls"))
