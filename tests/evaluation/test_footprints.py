"""Footprints against true ones."""

import math

import numpy as np
import pytest

from edgemap.evaluation.footprints import iou, score_footprints, yaw_error_deg
from edgemap.evaluation.objects import TrueObject
from edgemap.geometry.map_object import MapObject, MeasuredFootprint, outline_m

SQUARE = np.array([(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)])


def test_iou_by_hand():
    assert iou(SQUARE, SQUARE[::-1]) == pytest.approx(1.0)
    assert iou(SQUARE, SQUARE + [0.5, 0.0]) == pytest.approx(1 / 3, abs=0.02)
    assert iou(SQUARE, SQUARE + [3.0, 0.0]) == 0.0


def mapped(shape: MeasuredFootprint | None, x_m: float = 2.0) -> MapObject:
    return MapObject("couch-1", "couch", np.array([x_m, 0.0]), np.eye(2), 1.0, 1.0, 9, 0.9, 0.0, 1.0, measured=shape)


def test_figures_of_one_couch():
    corners = outline_m(mapped(MeasuredFootprint(2.0, 0.8, math.radians(10.0), 0.1)))
    truth = [TrueObject("couch", 2.0, 0.0, True, 20, tuple(map(tuple, corners.tolist())))]
    turned = score_footprints([mapped(MeasuredFootprint(2.0, 0.8, math.radians(178.0), 0.1))], truth)
    assert turned is not None
    assert turned["f1_iou25"] == 1.0
    assert turned["yaw_error_deg"] == pytest.approx(12.0, abs=0.1)
    circle = score_footprints([mapped(None)], truth)
    assert circle is not None
    assert (circle["oriented"], circle["yaw_error_deg"]) == (0.0, None)
    assert circle["mean_iou"] < turned["mean_iou"]
    away = score_footprints([mapped(None, 9.0)], truth)
    assert away is not None
    assert (away["f1_iou25"], away["mean_iou"]) == (0.0, None)
    assert score_footprints([mapped(None)], [TrueObject("couch", 2.0, 0.0, True, 20)]) is None


def test_a_quarter_turn_of_a_square_is_no_error():
    assert yaw_error_deg(SQUARE[[1, 2, 3, 0]] * [1.0, 0.9], SQUARE) == pytest.approx(0.0)
