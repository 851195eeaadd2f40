"""An occupancy grid at another scale, against a lookup of each cell's centre."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from edgemap.geometry.grid.occupancy_grid import OccupancyGrid


@given(
    st.floats(0.4, 2.5), st.integers(1, 12), st.integers(1, 12), st.floats(-2.0, 2.0), st.floats(-2.0, 2.0),
    st.integers(0, 99),
)  # fmt: skip
def test_each_cell_of_a_scaled_grid_takes_the_nearest_old_one(factor, rows, columns, x_m, y_m, seed):
    odds = np.random.default_rng(seed).integers(-100, 100, (rows, columns), dtype=np.int8)
    grid = OccupancyGrid(odds, x_m, y_m, 0.05)
    scaled = grid.scaled(factor)
    height, width = scaled.log_odds.shape
    assert (width * 0.05, height * 0.05) >= (columns * 0.05 * factor - 1e-6, rows * 0.05 * factor - 1e-6)
    for row in range(height):
        for column in range(width):
            x = ((column + 0.5) * 0.05 + scaled.x_m) / factor - x_m
            y = ((row + 0.5) * 0.05 + scaled.y_m) / factor - y_m
            near = [[int(np.clip(np.floor(at / 0.05 + e), 0, count - 1)) for e in (-1e-6, 1e-6)]
                    for at, count in ((y, rows), (x, columns))]  # fmt: skip
            assert scaled.log_odds[row, column] in odds[np.ix_(*near)]
