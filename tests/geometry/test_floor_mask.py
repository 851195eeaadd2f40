import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from edgemap.geometry.observations.floor_mask import FloorMask

HALF = np.array([[0.0, 0.0], [1.0, 1.0]], dtype=np.float32)  # floor below


def test_cells_middles_have_their_own_value_and_between_them_it_is_linear():
    mask = FloorMask(HALF, width=8, height=4)
    # Cell (0, c) covers rows 0 and 1, so its middle is the edge between them, 0.5 in pixel centres.
    np.testing.assert_allclose(mask.at([[3.0, 0.5], [3.0, 2.5], [3.0, 1.5], [3.0, 1.0]]), [0.0, 1.0, 0.5, 0.25])


def test_outside_the_picture_and_nowhere_there_is_no_floor():
    mask = FloorMask(np.ones((2, 2), np.float32), width=8, height=4)
    points = [[-0.6, 1.0], [7.6, 1.0], [1.0, 3.6], [np.nan, 1.0], [np.inf, 1.0], [-0.5, -0.5], [7.5, 3.5]]
    np.testing.assert_array_equal(mask.at(points), [0, 0, 0, 0, 0, 1, 1])
    assert mask.at(np.zeros((0, 2))).shape == (0,)


@given(
    st.integers(1, 9), st.integers(1, 9), st.integers(1, 700), st.integers(1, 700),
    st.floats(0, 1), st.floats(0, 1), st.integers(0, 99),
)  # fmt: skip
def test_any_point_has_a_value_between_those_of_cells(rows, columns, width, height, x, y, seed):
    floor = np.random.default_rng(seed).random((rows, columns), dtype=np.float32)
    (value,) = FloorMask(floor, width, height).at([[x * width - 0.5, y * height - 0.5]])
    assert floor.min() - 1e-6 <= value <= floor.max() + 1e-6
    right, down = min(int(x * columns), columns - 1), min(int(y * rows), rows - 1)
    around = floor[max(down - 1, 0) : down + 2, max(right - 1, 0) : right + 2]
    assert around.min() - 1e-6 <= value <= around.max() + 1e-6


def test_what_hides_a_foot_ends_where_floor_begins_in_most_columns():
    floor = np.zeros((8, 6), dtype=np.float32)
    floor[5:, 1:4], floor[7:, 4] = 1.0, 1.0
    mask = FloorMask(floor, width=60, height=80)
    assert mask.hidden_until((10, 0, 49, 25)) == 50.0  # rows 50, 50, 50 and 70
    assert mask.hidden_until((10, 0, 49, 45)) is None  # floor at the edge
    assert mask.hidden_until((50, 0, 59, 45)) == 80.0  # none down to the border
    assert mask.hidden_until((10, 0, 49, 75)) is None  # nothing is known below


def test_shapes_must_agree():
    with pytest.raises(ValueError, match="walls"):
        FloorMask(HALF, 8, 4, wall=np.zeros((3, 2), np.float32))
    with pytest.raises(ValueError, match="0x4"):
        FloorMask(HALF, 0, 4)
