import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from edgemap.geometry.odometry.planar import fit_se2, planar_motion
from edgemap.geometry.se2 import SE2

motions = st.builds(SE2, st.floats(-0.3, 0.3), st.floats(-0.1, 0.1), st.floats(-0.5, 0.5))


@given(motions, st.integers(0, 10**6))
def test_fit_recovers_an_exact_motion(motion, seed):
    points = np.random.default_rng(seed).uniform([0.5, -2], [5, 2], (20, 2))
    found = fit_se2(points, motion.apply(points), np.ones(20))
    np.testing.assert_allclose(found.vector(), motion.vector(), atol=1e-9)


@settings(max_examples=30, deadline=None)
@given(motions, st.integers(0, 10**6))
def test_a_third_of_wrong_tracks_does_no_harm(motion, seed):
    rng = np.random.default_rng(seed)
    current = rng.uniform([0.5, -2], [4, 2], (90, 2))
    previous = motion.apply(current) + rng.normal(0, 0.004, (90, 2))
    previous[:30] += rng.uniform(-1, 1, (30, 2))
    found = planar_motion(previous, current, np.full(90, 0.005), rng)
    assert found is not None
    assert np.abs(found.vector() - motion.vector())[:2].max() < 0.01


@pytest.mark.parametrize("count", [0, 1, 5])
def test_too_few_points_give_no_motion(count):
    points = np.random.default_rng(0).uniform(1, 2, (count, 2))
    assert planar_motion(points, points, np.full(count, 0.01), np.random.default_rng(0)) is None


def test_points_that_agree_on_nothing_give_no_motion():
    rng = np.random.default_rng(0)
    assert planar_motion(rng.uniform(0, 5, (40, 2)), rng.uniform(0, 5, (40, 2)), np.full(40, 1e-4), rng) is None


def test_points_weigh_by_their_information():
    """Half of the points, at a sigma of 1 cm, say 0.100 m; the others, at 2 cm, 0.110 m: (4 * 0.100 + 0.110) / 5."""
    before = np.random.default_rng(5).uniform(1.0, 3.0, (40, 2))
    sigmas, moved = np.repeat([0.01, 0.02], 20), np.repeat([0.100, 0.110], 20)
    before[20:] = before[:20]  # so that only the shift differs
    after = before - np.column_stack([moved, np.zeros(40)])
    found = planar_motion(before, after, sigmas, np.random.default_rng(0))
    assert found is not None
    assert found.x_m == pytest.approx(0.102, abs=2e-4)
