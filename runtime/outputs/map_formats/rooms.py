"""Rooms: parts of the observed floor that walls and doors enclose unambiguously."""

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import cast

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation, binary_fill_holes, distance_transform_edt, label

from edgemap.geometry.arrays import Array
from edgemap.geometry.grid.occupancy_grid import FREE, OCCUPIED, OccupancyGrid
from edgemap.geometry.grid.walls import Wall, walls_of

Mask = NDArray[np.bool_]
Labelled = tuple[NDArray[np.int32], int]
DOOR_M = 1.1  # what is narrower between two walls parts two rooms
LEAST_M2 = 3.0  # of a room
CORE_M2 = 0.3  # of what is left of a room when everything within half a door of its walls is taken away
CLOSED = 0.75  # of a room's outline, at least, is a wall, an obstacle or another room; the rest was not seen
BESIDE_M = 0.2
TOLERANCE_M = 0.15  # of an outline against its cells


@dataclass(frozen=True, slots=True)
class Room:
    """corners_m: of its outline, counter-clockwise, map frame. closed: share of the outline that is bounded."""

    corners_m: tuple[tuple[float, float], ...]
    area_m2: float
    closed: float


@lru_cache(maxsize=4)
def rooms_of(grid: OccupancyGrid) -> tuple[Room, ...]:
    """The rooms of a grid, the largest first; empty where none is enclosed."""
    cell_m = grid.cell_m
    barrier = _drawn(walls_of(grid), grid)
    inside = cast(Mask, binary_fill_holes((grid.cells == FREE) | (grid.cells == OCCUPIED) | barrier)) & ~barrier
    clearance_m = np.asarray(distance_transform_edt(np.pad(inside, 1)))[1:-1, 1:-1] * cell_m
    cores, count = cast(Labelled, label(clearance_m > DOOR_M / 2.0))
    sizes = np.bincount(cores.ravel(), minlength=count + 1) * cell_m**2
    cores[(sizes < CORE_M2)[cores]] = 0
    if not cores.any():
        return ()
    _, nearest = cast(tuple[Array, NDArray[np.intp]], distance_transform_edt(cores == 0, return_indices=True))
    owner = np.where(inside, cores[nearest[0], nearest[1]], 0)
    stops = cast(Mask, binary_dilation(barrier | (grid.cells == OCCUPIED), iterations=max(round(BESIDE_M / cell_m), 1)))
    rooms = []
    for number in np.unique(owner[owner > 0]):
        mask = _largest(owner == number)
        outline = np.pad(mask, 1)
        outline = mask & ~(outline[:-2, 1:-1] & outline[2:, 1:-1] & outline[1:-1, :-2] & outline[1:-1, 2:])
        others = cast(Mask, binary_dilation((owner > 0) & (owner != number)))
        closed = float((outline & (stops | others)).sum() / max(outline.sum(), 1))
        area_m2 = float(mask.sum()) * cell_m**2
        if area_m2 >= LEAST_M2 and closed >= CLOSED:
            rooms.append(Room(tuple((float(x), float(y)) for x, y in _outline_m(mask, grid)), area_m2, closed))
    return tuple(sorted(rooms, key=lambda room: -room.area_m2))


def _drawn(walls: tuple[Wall, ...], grid: OccupancyGrid) -> Mask:
    """Walls as cells, two wide, so that no path slips through a corner."""
    drawn = np.zeros(grid.cells.shape, np.bool_)
    for wall in walls:
        steps = np.linspace(0.0, 1.0, max(math.ceil(2.0 * wall.length_m / grid.cell_m), 2))[:, None]
        points = np.array(wall.from_m) * (1.0 - steps) + np.array(wall.to_m) * steps
        cells = np.floor((points - [grid.x_m, grid.y_m]) / grid.cell_m).astype(np.intp)
        column, row = cells[:, 0], cells[:, 1]
        good = (row >= 0) & (column >= 0) & (row < len(drawn)) & (column < grid.cells.shape[1])
        drawn[row[good], column[good]] = True
    return np.asarray(binary_dilation(drawn), dtype=np.bool_)


def _largest(mask: Mask) -> Mask:
    """The largest connected part."""
    parts, count = cast(Labelled, label(mask))
    return parts == 1 + int(np.bincount(parts.ravel(), minlength=count + 1)[1:].argmax())


def _outline_m(mask: Mask, grid: OccupancyGrid) -> Array:
    """Corners (N, 2) of the outer border of a connected mask, counter-clockwise, map frame; within TOLERANCE_M."""
    doubled = np.kron(mask, np.ones((2, 2), np.uint8)).astype(np.uint8)  # borders nearer to cells' edges
    contours, _ = cv2.findContours(doubled, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    loop = max(contours, key=len)
    corners = cv2.approxPolyDP(loop, 2.0 * TOLERANCE_M / grid.cell_m, True)[:, 0] + 0.5
    turned = corners if cv2.contourArea(loop, oriented=True) > 0.0 else corners[::-1]
    return np.asarray(turned * (grid.cell_m / 2.0) + [grid.x_m, grid.y_m], dtype=np.float64)
