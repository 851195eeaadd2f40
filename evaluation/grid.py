"""Scores of an occupancy grid against a floor plan: free and occupied cells, and walls."""

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt

from edgemap.evaluation.objects import share
from edgemap.evaluation.rooms import TruePlan
from edgemap.geometry.arrays import Array
from edgemap.geometry.grid.occupancy_grid import FREE, OCCUPIED, GridRule, OccupancyGrid
from edgemap.geometry.grid.rooms import inside

NEAR_M = 0.10  # two cells: what a map may be off and still keep a robot from a wall
SEEN_M = 0.25  # an edge this close to floor that the grid has as free was in view
OVERHEAD_M, FLAT_M = 0.3, 0.02  # what hangs higher is over the floor, what is flatter is part of it
OUTSIDE, FLOOR, WALL, FURNITURE = range(4)
MARGIN_M = 1.0


def score_grid(grid: OccupancyGrid | None, truth: TruePlan) -> dict[str, Any]:
    """`free`: precision (cells that are floor without furniture), precision_10cm (within 10 cm of such), recall (of all
    such floor). `occupied`: precision_10cm (within 10 cm of a wall or furniture). `walls`: recall, of the wall's edge
    within 25 cm of floor that the grid has as free, how much has an occupied cell within 10 cm. None where nothing can
    be scored. No alignment; a footprint is furniture's bounding rectangle, so the floor under a table does not count as
    floor. A grid of None is entirely unknown.
    """
    grid = grid or OccupancyGrid(np.zeros((1, 1), np.int8), 0.0, 0.0, GridRule().cell_m)
    cells, kinds = _on_one_lattice(grid, truth)
    cell_m = grid.cell_m
    free, occupied, floor, wall = cells == FREE, cells == OCCUPIED, kinds == FLOOR, kinds == WALL
    solid = wall | (kinds == FURNITURE)
    to_floor, to_solid, to_occupied, to_free = (_away_m(mask, cell_m) for mask in (floor, solid, occupied, free))
    edge = wall & (to_floor <= 1.5 * cell_m) & (to_free <= SEEN_M)
    return {
        "free": {
            "precision": _share(floor, free),
            "precision_10cm": _share(to_floor <= NEAR_M + 1e-9, free),
            "recall": _share(free, floor),
        },
        "occupied": {"precision_10cm": _share(to_solid <= NEAR_M + 1e-9, occupied)},
        "walls": {"recall": _share(to_occupied <= NEAR_M + 1e-9, edge)},
    }


def _on_one_lattice(grid: OccupancyGrid, truth: TruePlan) -> tuple[NDArray[np.int8], NDArray[np.uint8]]:
    """The grid's cells and the true kinds of the same cells, wide enough for both."""
    cell_m, origin = grid.cell_m, np.array([grid.x_m, grid.y_m])
    floor = [*truth.rooms, *truth.doorways]
    points = np.concatenate([*floor, *truth.walls])
    first = np.minimum(np.floor((points.min(axis=0) - MARGIN_M - origin) / cell_m).astype(int), 0)
    size = np.array(grid.cells.shape[::-1])
    last = np.maximum(np.ceil((points.max(axis=0) + MARGIN_M - origin) / cell_m).astype(int), size)
    axes = (start + (np.arange(low, high) + 0.5) * cell_m for start, low, high in zip(origin, first, last, strict=True))
    centres = np.stack(np.meshgrid(*axes), axis=-1)
    kinds = np.full(centres.shape[:2], OUTSIDE, np.uint8)
    for kind, polygons in ((FLOOR, floor), (FURNITURE, truth.footprints), (WALL, truth.walls)):
        for polygon in polygons:
            kinds[inside(polygon, centres) & ((kinds == FLOOR) | (kind != FURNITURE))] = kind
    return grid.at(centres).reshape(kinds.shape), kinds


def _away_m(mask: NDArray[np.bool_], cell_m: float) -> Array:
    """Distance of every cell to the nearest of a mask, metres; infinite where there is none."""
    if not mask.any():
        return np.full(mask.shape, np.inf)
    return np.asarray(distance_transform_edt(~mask), dtype=np.float64) * cell_m


def _share(right: NDArray[np.bool_], judged: NDArray[np.bool_]) -> float | None:
    """Of the judged cells those that are right; None of none."""
    return share(int((right & judged).sum()), int(judged.sum()))
