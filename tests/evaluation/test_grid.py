"""Figures of the grid, of rooms and doors and of floor masks, against plans and pictures by hand."""

from dataclasses import replace

import numpy as np
import pytest

from edgemap.evaluation.floor import FloorScore, contact_rows, contacts
from edgemap.evaluation.grid import score_grid
from edgemap.evaluation.rooms import TruePlan, score_rooms
from edgemap.geometry.camera.floor import FloorCamera
from edgemap.geometry.camera.intrinsics import Intrinsics
from edgemap.geometry.camera.mount import Mount
from edgemap.geometry.grid.occupancy_grid import OccupancyGrid
from edgemap.geometry.grid.rooms import Door, Room
from edgemap.geometry.observations.floor_mask import FloorMask
from edgemap.geometry.se2 import SE2


def box(x0, y0, x1, y1):
    return np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]], dtype=float)


# A room of 2 x 1 m with a wall of 0.2 m behind x = 2 and furniture in its last 0.5 m, in cells of 0.1 m.
TRUTH = TruePlan([box(0, 0, 2, 1)], ["kitchen"], [], [box(2, 0, 2.2, 1)], [box(1.5, 0, 2.0, 1.0)])


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
    bare = replace(TRUTH, footprints=[])
    half = [(column, row) for column in range(20) for row in range(5)]
    seen = score_grid(grid(free=half, occupied=[(20, row) for row in range(3)]), bare)
    # Rows 0 to 6 of the wall are within 25 cm of free floor, rows 0 to 3 within 10 cm of an occupied cell.
    assert seen["walls"]["recall"] == pytest.approx(4 / 7, abs=1e-4)


def test_a_grid_far_off_and_turned_polygons_are_judged_in_one_frame():
    turn = np.array([[0.0, -1.0], [1.0, 0.0]])
    rooms, walls = ([polygon @ turn.T + [5.0, -3.0] for polygon in part] for part in (TRUTH.rooms, TRUTH.walls))
    moved = OccupancyGrid(np.full((10, 5), -40, np.int8), 4.5, -3.0, 0.1)
    plan = TruePlan(rooms, TRUTH.kinds, [], walls)
    assert score_grid(moved, plan)["free"] == {"precision": 1.0, "precision_10cm": 1.0, "recall": 0.25}


def test_what_saw_nothing_has_nulls():
    figures = score_grid(None, TRUTH)
    assert figures["free"] == {"precision": None, "precision_10cm": None, "recall": 0.0}
    assert (figures["occupied"]["precision_10cm"], figures["walls"]["recall"]) == (None, None)
    nothing = {"found": 0.0, "mean_iou": None, "precision": None, "kinds": None}
    assert scored([], []) == {"rooms": nothing, "doors": {"precision": None, "recall": 0.0}}


PLAN = TruePlan(
    [box(0, 0, 3, 4), box(3.1, 0, 6, 4), box(6.1, 0, 9, 4)],
    ["kitchen", "study", "bedroom"],
    [box(3, 1.5, 3.1, 2.5), box(6, 0, 6.1, 0.8)],
    [box(3, 0, 3.1, 1.5), box(3, 2.5, 3.1, 4), box(6, 0.8, 6.1, 4), box(6, 0, 6.1, 0.8), box(-0.1, 0, 0, 4)],
)
POSES = [SE2(x, 2.0, yaw) for x in (1.5, 4.5) for yaw in np.linspace(0.0, 6.0, 12)]


def scored(rooms, doors):
    return score_rooms(rooms, doors, PLAN, POSES, 1.0)


def test_only_what_was_seen_is_asked_for_and_judged():
    rooms = [Room("room-1", tuple(map(tuple, box(0, 0, 3, 3.2))), "kitchen"), Room("room-2", ((9, 9), (9, 8), (8, 8)))]
    door = Door("door-1", (3.0, 1.7), (3.0, 2.6), ("room-1", "room-2"), 0.9)
    figures = scored([*rooms, Room("room-3", tuple(map(tuple, PLAN.rooms[2])))], [door])
    assert figures["rooms"] == {"found": 0.5, "mean_iou": pytest.approx(0.8, abs=0.02), "precision": 0.5, "kinds": 1.0}
    assert figures["doors"] == {"precision": 1.0, "recall": 1.0}
    wrong = Door("door-2", (1.0, 1.0), (2.0, 1.0), ("room-1", "room-2"), 0.9)
    assert scored(rooms, [wrong])["doors"] == {"precision": 0.0, "recall": 0.0}


def labels_from(rows):
    """Labels of a picture of 8x10 px whose floor begins at a row."""
    labels = np.zeros((10, 8), np.uint8)
    labels[rows:] = 1
    return labels


def mask_from(rows):
    """The mask of such a picture, cell by pixel."""
    return FloorMask(labels_from(rows).astype(np.float32), 8, 10)


def test_overlap_is_pooled_over_pictures_and_leaves_out_what_is_unknown():
    score = FloorScore()
    score.add(mask_from(6), labels_from(4))  # 4 of 6 rows
    unknown = labels_from(5)
    unknown[5:7] = 255
    score.add(mask_from(5), unknown)  # 3 of 3 rows
    row = score.row()
    assert row["iou"] == pytest.approx((4 + 3) / (6 + 3), abs=1e-4)
    assert row["pictures"] == 2
    assert row["contact_m"] is None


def test_a_contact_is_where_the_lowest_run_of_floor_ends():
    floor = labels_from(6).astype(bool)
    floor[2:4, 0] = True  # beyond an object
    floor[:, 1] = False
    floor[:, 2] = True
    np.testing.assert_array_equal(contact_rows(floor), [5.5, 9.5, -0.5, 5.5, 5.5, 5.5, 5.5, 5.5])
    known = np.ones_like(floor)
    known[5, 3] = False
    rows, columns = contacts(floor, known)
    np.testing.assert_array_equal(columns, [0, 4, 5, 6, 7])
    np.testing.assert_array_equal(rows, [5.5] * 5)


def test_errors_in_pixels_and_on_the_floor():
    camera = FloorCamera(Intrinsics(8, 10, 10.0, 10.0, 3.5, 0.0), Mount(1.0))  # level: row r meets it at 10 / r metres
    score = FloorScore()
    score.add(mask_from(6), labels_from(4), camera)  # 10 / 5.5 m for 10 / 3.5 m
    row = score.row()
    assert row["boundary_px"] == 2.0
    # The middle column meets the floor straight ahead; those beside it farther out, by at most a quarter.
    contact_m = row["contact_m"]
    assert 10 / 3.5 - 10 / 5.5 <= contact_m <= 1.25 * (10 / 3.5 - 10 / 5.5)


@pytest.mark.parametrize(("begins", "iou", "boundary_px"), [(4, 0.0, 6.0), (10, None, None)])
def test_a_mask_without_floor_is_as_wrong_as_can_be_where_there_is_some(begins, iou, boundary_px):
    score = FloorScore()
    score.add(mask_from(10), labels_from(begins))
    assert score.row() == {"iou": iou, "boundary_px": boundary_px, "contact_m": None, "pictures": 1}
