"""The grid's figures: numbers by hand on a room of one by one metre."""

import numpy as np
import pytest

from edgemap.evaluation.grid import TrueFloor, score_grid
from edgemap.geometry.grid.occupancy_grid import OccupancyGrid


def box(x0, y0, x1, y1):
    return np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]], dtype=float)


# A room of 2 x 1 m with a wall of 0.2 m behind x = 2 and furniture in its last 0.5 m, in cells of 0.1 m.
TRUTH = TrueFloor([box(0, 0, 2, 1)], [box(2, 0, 2.2, 1)], [box(1.5, 0, 2.0, 1.0)])


def grid(free=(), occupied=()):
    """A grid of 3 x 1 m from x = 0 with cells by column and row."""
    odds = np.zeros((10, 30), np.int8)
    for value, cells in ((-40, free), (40, occupied)):
        for column, row in cells:
            odds[row, column] = value
    return OccupancyGrid(odds, 0.0, 0.0, 0.1)


def columns(first, last):
    return [(column, row) for column in range(first, last) for row in range(10)]


def test_free_cells_are_judged_by_what_stands_there_and_by_how_far_they_are_from_floor():
    figures = score_grid(grid(free=columns(5, 17)), TRUTH)  # ten columns of floor, two of furniture
    assert figures["free"]["precision"] == pytest.approx(10 / 12, abs=1e-4)
    assert figures["free"]["precision_10cm"] == pytest.approx(11 / 12, abs=1e-4)  # one of the two is 10 cm from floor
    assert figures["free"]["recall"] == pytest.approx(10 / 15, abs=1e-4)
    assert figures["occupied"]["precision_10cm"] is None


def test_occupied_cells_are_right_within_10_cm_of_wall_or_furniture():
    # An obstacle is one only within 15 cm of free floor, so a column of it on each side; 20 and 10 cm before furniture.
    figures = score_grid(grid(free=columns(12, 13) + columns(15, 16), occupied=columns(13, 15)), TRUTH)
    assert figures["occupied"]["precision_10cm"] == pytest.approx(0.5)
    assert figures["free"] == {"precision": 0.5, "precision_10cm": 1.0, "recall": pytest.approx(1 / 15, abs=1e-4)}
    assert figures["walls"]["recall"] is None  # none was in view


def test_of_walls_only_those_beside_seen_floor_are_asked_for():
    bare = TrueFloor(TRUTH.floor, TRUTH.walls, [])
    half = [(column, row) for column in range(20) for row in range(5)]
    seen = score_grid(grid(free=half, occupied=[(20, row) for row in range(3)]), bare)
    # Rows 0 to 6 of the wall are within 25 cm of free floor, rows 0 to 3 within 10 cm of an occupied cell.
    assert seen["walls"]["recall"] == pytest.approx(4 / 7, abs=1e-4)


def test_a_grid_far_off_and_turned_polygons_are_judged_in_one_frame():
    turn = np.array([[0.0, -1.0], [1.0, 0.0]])
    polygons = ([polygon @ turn.T + [5.0, -3.0] for polygon in part] for part in (TRUTH.floor, TRUTH.walls, []))
    moved = OccupancyGrid(np.full((10, 5), -40, np.int8), 4.5, -3.0, 0.1)
    assert score_grid(moved, TrueFloor(*polygons))["free"] == {"precision": 1.0, "precision_10cm": 1.0, "recall": 0.25}


def test_a_drive_that_saw_no_floor_has_nulls_and_no_recall():
    figures = score_grid(None, TRUTH)
    assert figures["free"] == {"precision": None, "precision_10cm": None, "recall": 0.0}
    assert (figures["occupied"]["precision_10cm"], figures["walls"]["recall"]) == (None, None)
