"""A worktop that the floor head takes for floor shows by what stands on it."""

import numpy as np
import pytest

from edgemap.geometry.observations.detections import Detections
from edgemap.geometry.observations.floor_mask import FloorMask
from edgemap.geometry.observations.worktop import is_worktop

NAMES = ("chair", "cup")
LOWER_HALF = FloorMask(np.repeat([[0.0], [1.0]], 8, axis=1).repeat(3, axis=0).astype(np.float32), 640, 480)


def box(label, foot_px):
    return Detections(
        np.array([[300.0, foot_px - 50.0, 340.0, foot_px]]), np.array([0.9]), np.array([NAMES.index(label)]), NAMES
    )


@pytest.mark.parametrize(
    ("label", "foot_px", "found"),
    [("cup", 400.0, True), ("cup", 200.0, False), ("chair", 400.0, False), ("cup", 480.0, True)],
)
def test_a_cup_on_the_mask_shows_a_worktop(label, foot_px, found):
    assert is_worktop(LOWER_HALF, box(label, foot_px)) is found


def test_without_mask_or_boxes_there_is_none():
    assert not is_worktop(None, box("cup", 400.0))
    assert not is_worktop(LOWER_HALF, Detections.none(NAMES))
