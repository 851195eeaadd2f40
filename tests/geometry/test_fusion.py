import numpy as np
import pytest

from edgemap.geometry.odometry.consensus import MotionEstimate, consensus, fused


def measured(x_m, sigma_m=0.01):
    return MotionEstimate(np.array([x_m, 0.0, 0.0]), np.diag([sigma_m**2, sigma_m**2, 0.01**2]))


def test_independent_ones_are_weighted_by_what_they_know():
    """0.10 +- 0.01 and 0.12 +- 0.02: weights 4 to 1, so 0.104; variance 1 / (1e4 + 2.5e3) = 8e-5."""
    found = fused(measured(0.10), measured(0.12, 0.02))
    assert found.motion[0] == pytest.approx(0.104)
    assert found.covariance[0, 0] == pytest.approx(8e-5)


def test_two_of_three_sources_outvote_the_third():
    gyro = MotionEstimate(np.zeros(3), np.diag([1.0, 1.0, 1e-8]))
    spinning = MotionEstimate(np.array([0.0, 0.0, 0.3]), np.diag([1e-6, 1e-6, 1e-6]))
    found = consensus({"camera": measured(0.10, 0.001), "wheels": spinning, "gyro": gyro})
    assert (found.conflict, found.motion[0]) == ("", pytest.approx(0.10, abs=1e-4))


def test_a_source_that_knows_no_translation_says_nothing_of_it_in_a_conflict():
    """Camera and gyro disagree on yaw alone: halfway there, the camera's translation."""
    gyro = MotionEstimate(np.array([0.0, 0.0, 0.2]), np.diag([1.0, 1.0, 1e-4]))
    found = consensus({"camera": measured(0.10, 0.001), "gyro": gyro})
    assert found.conflict
    assert found.motion == pytest.approx([0.099, 0.0, 0.1], abs=1e-4)
    assert found.covariance[2, 2] == pytest.approx(0.1**2 + 1e-4)


def test_independent_measurements_add_their_information_whatever_their_axes():
    random = np.random.default_rng(2)
    a, b = (part @ part.T + 0.1 * np.eye(3) for part in random.normal(0.0, 1.0, (2, 3, 3)))
    x, y = random.normal(0.0, 0.1, (2, 3))
    found = fused(MotionEstimate(x, a), MotionEstimate(y, b))
    information = np.linalg.inv(a) + np.linalg.inv(b)
    assert found.covariance == pytest.approx(np.linalg.inv(information))
    expected = np.linalg.solve(information, np.linalg.solve(a, x) + np.linalg.solve(b, y))
    assert found.motion == pytest.approx(expected)


def test_what_sources_disagree_about_is_covered_around_the_middle():
    """0.1 and 0.3 m at 0.01 m: 0.2 m, with the 0.1 m to either of them on top."""
    small = np.diag([1e-4, 1e-4, 1e-4])
    camera, wheels = (MotionEstimate(np.array([x_m, 0.0, 0.0]), small) for x_m in (0.1, 0.3))
    found = consensus({"camera": camera, "wheels": wheels})
    assert found.conflict == "camera against wheels"
    assert found.motion == pytest.approx([0.2, 0.0, 0.0])
    assert found.covariance == pytest.approx(np.diag([1e-4 + 0.01, 1e-4, 1e-4]))
