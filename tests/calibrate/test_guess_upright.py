"""Pictures that are not upright show by what a detector recognises."""

import numpy as np
import pytest

from edgemap.calibrate.guess import quarter_turns
from edgemap.geometry.observations.detections import Detections


def bright_top(picture):
    """A detector that recognises a picture with a bright top for sure, and others hardly."""
    score = 0.9 if picture[: len(picture) // 4].mean() > 200 else 0.2
    return Detections(np.zeros((1, 4)), np.array([score]), np.array([0]), ("chair",))


@pytest.mark.parametrize("turns", range(4))
def test_the_turn_that_makes_pictures_upright_is_found(turns):
    upright = np.zeros((40, 60, 3), dtype=np.uint8)
    upright[:15] = 255
    assert quarter_turns([np.rot90(upright, -turns)] * 25, bright_top) == turns


def test_where_none_is_clearly_better_pictures_stay():
    assert quarter_turns([np.zeros((40, 60, 3), dtype=np.uint8)] * 3, bright_top) == 0
    assert quarter_turns([], bright_top) == 0
