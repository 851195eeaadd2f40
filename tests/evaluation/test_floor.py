"""Overlap and contact errors by hand."""

import numpy as np
import pytest

from edgemap.evaluation.floor import FloorScore, contact_rows, contacts
from edgemap.geometry.camera.floor import FloorCamera
from edgemap.geometry.camera.intrinsics import Intrinsics
from edgemap.geometry.camera.mount import Mount
from edgemap.geometry.observations.floor_mask import FloorMask


def mask_from(rows, width=8, height=10):
    """A mask of a picture whose floor begins at a row, cell by pixel."""
    floor = np.zeros((height, width), np.float32)
    floor[rows:] = 1.0
    return FloorMask(floor, width, height)


def labels_from(rows, width=8, height=10):
    labels = np.zeros((height, width), np.uint8)
    labels[rows:] = 1
    return labels


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
    assert contact_m is not None
    assert 10 / 3.5 - 10 / 5.5 <= contact_m <= 1.25 * (10 / 3.5 - 10 / 5.5)


def test_a_mask_without_floor_is_as_wrong_as_can_be():
    score = FloorScore()
    score.add(mask_from(10), labels_from(4))
    assert score.row() == {"iou": 0.0, "boundary_px": 6.0, "contact_m": None, "pictures": 1}


def test_nothing_to_score_is_none():
    score = FloorScore()
    score.add(mask_from(10), labels_from(10))
    assert score.row() == {"iou": None, "boundary_px": None, "contact_m": None, "pictures": 1}
