import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from edgemap.geometry.se2 import SE2, fit_se2

motions = st.builds(SE2, st.floats(-0.3, 0.3), st.floats(-0.1, 0.1), st.floats(-0.5, 0.5))


@given(motions, st.integers(0, 10**6))
def test_fit_recovers_an_exact_motion(motion, seed):
    points = np.random.default_rng(seed).uniform([0.5, -2], [5, 2], (20, 2))
    found = fit_se2(points, motion.apply(points), np.ones(20))
    np.testing.assert_allclose(found.vector(), motion.vector(), atol=1e-9)


def test_points_weigh_by_their_information():
    """Half of the points, at a sigma of 1 cm, say 0.100 m; the others, at 2 cm, 0.110 m: (4 * 0.100 + 0.110) / 5."""
    before = np.random.default_rng(5).uniform(1.0, 3.0, (40, 2))
    sigmas, moved = np.repeat([0.01, 0.02], 20), np.repeat([0.100, 0.110], 20)
    before[20:] = before[:20]  # so that only the shift differs
    after = before - np.column_stack([moved, np.zeros(40)])
    assert fit_se2(after, before, sigmas**-2.0).x_m == pytest.approx(0.102, abs=2e-4)
