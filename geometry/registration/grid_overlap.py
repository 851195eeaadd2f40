"""How well two grids agree under a motion: occupied cells of one on those of the other, counted against chance."""

from functools import lru_cache

import numpy as np
from scipy.ndimage import distance_transform_edt
from scipy.special import bdtrc

from edgemap.geometry.arrays import Array
from edgemap.geometry.grid.occupancy_grid import OCCUPIED, UNKNOWN, GridRule, OccupancyGrid
from edgemap.geometry.grid.rooms import Mask
from edgemap.geometry.grid.walls import ASIDE_CELLS
from edgemap.geometry.registration.hypotheses import SAME_PLACE_M, SAME_TURN_RAD
from edgemap.geometry.se2 import SE2

NEAR_M = ASIDE_CELLS * GridRule().cell_m  # of an occupied cell to one of the other grid
APART_M = 1.0  # along a contour between two cells that agree independently: walls and furniture are straight that long
STEP_RAD = SAME_TURN_RAD / 4.0  # between two directions that are tried
Grids = tuple[OccupancyGrid | None, OccupancyGrid | None]


@lru_cache(maxsize=16)
def _near(grid: OccupancyGrid) -> tuple[Mask, Array, Mask]:
    """Cells near an occupied one, how near they are (1 on it, half at the edge), and cells that are observed or near
    one."""
    distance_m = np.asarray(distance_transform_edt(grid.cells != OCCUPIED)) * grid.cell_m
    near = distance_m <= NEAR_M
    return near, near * (1.0 - distance_m / (2.0 * NEAR_M)), near | (grid.cells != UNKNOWN)


def fitted_grid(grids: Grids, pose: SE2) -> tuple[SE2, Array, float] | None:
    """The motion near a pose that lays the most occupied cells of the second grid onto those of the first one, its
    covariance (3, 3), m, m, rad, and the probability that grids of unrelated places agree as well near a pose. None
    where a grid lacks or has no occupied cell."""
    first, second = grids
    if first is None or second is None:
        return None
    near, nearness, known = _near(first)
    contour = second.centres_m(second.cells == OCCUPIED)
    if not len(contour) or not near.any():
        return None
    share = near.sum() / known.sum()
    points = contour[:: 1 + len(contour) // 200]  # so many are compared at most
    middle = points.mean(axis=0)
    steps = np.arange(-SAME_PLACE_M, SAME_PLACE_M + NEAR_M / 2.0, NEAR_M)
    shifts = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 1, 2)
    best = (-1.0, 0, 0, pose)
    for turn_rad in np.arange(-SAME_TURN_RAD, SAME_TURN_RAD + STEP_RAD / 2.0, STEP_RAD):
        turn = SE2(0.0, 0.0, pose.yaw_rad + float(turn_rad))
        places = turn.apply(points - middle) + pose.apply(middle) + shifts
        columns, rows = np.moveaxis(np.floor((places - (first.x_m, first.y_m)) / first.cell_m).astype(np.intp), -1, 0)
        inside = (rows >= 0) & (columns >= 0) & (rows < len(near)) & (columns < len(near[0]))
        rows, columns = np.where(inside, rows, 0), np.where(inside, columns, 0)
        hits, fit, seen = ((inside * cells[rows, columns]).sum(axis=1) for cells in (near, nearness, known))
        row = int(np.argmax(fit - share * seen))  # where all are near, in the middle of that
        if (score := float(fit[row] - share * seen[row])) > best[0]:
            x_m, y_m = pose.apply(middle) + shifts[row, 0] - turn.apply(middle)
            best = (score, int(hits[row]), int(seen[row]), SE2(x_m, y_m, turn.yaw_rad))
    _, hits, seen, pose = best
    independent = second.cell_m / APART_M * len(contour) / len(points)
    tried = (SAME_PLACE_M / NEAR_M) ** 2 * SAME_TURN_RAD / STEP_RAD
    matched, count = int(hits * independent), int(seen * independent)
    chance = tried * float(bdtrc(matched - 1, count, share)) if matched else 1.0
    x_m, y_m = SE2(0.0, 0.0, pose.yaw_rad).apply(middle)
    wrt_middle = np.array([[1.0, 0.0, y_m], [0.0, 1.0, -x_m], [0.0, 0.0, 1.0]])  # which the grid turns about
    covariance = wrt_middle @ np.diag([NEAR_M**2, NEAR_M**2, STEP_RAD**2]) @ wrt_middle.T
    return pose, covariance, min(chance, 1.0)
