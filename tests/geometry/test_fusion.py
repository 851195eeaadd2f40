import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from edgemap.geometry.odometry.covariance_intersection import MotionEstimate, consensus, fused, intersected


def measured(x_m, sigma_m=0.01, yaw_rad=0.0, source="camera"):
    return MotionEstimate(np.array([x_m, 0.0, yaw_rad]), np.diag([sigma_m**2, sigma_m**2, 0.01**2]), source)


def test_independent_ones_are_weighted_by_what_they_know():
    """0.10 +- 0.01 and 0.12 +- 0.02: weights 4 to 1, so 0.104; variance 1 / (1e4 + 2.5e3) = 8e-5."""
    found = fused(measured(0.10), measured(0.12, 0.02))
    assert found.motion[0] == pytest.approx(0.104)
    assert found.covariance[0, 0] == pytest.approx(8e-5)


spd = st.builds(
    lambda values: (lambda a: a @ a.T + 0.05 * np.eye(3))(np.reshape(values, (3, 3))),
    st.lists(st.floats(-1.0, 1.0), min_size=9, max_size=9),
)


@given(spd, spd, st.floats(-1.0, 1.0))
def test_intersection_claims_nothing_that_correlated_errors_could_belie(p, q, correlation):
    """Whatever the correlation of two errors, the mixture's true covariance is within what intersection claims."""
    a, b = MotionEstimate(np.zeros(3), p, "camera"), MotionEstimate(np.array([0.1, 0.0, 0.0]), q, "camera")
    found = intersected(a, b)
    assert np.linalg.det(found.covariance) <= min(np.linalg.det(p), np.linalg.det(q)) * (1 + 1e-9)
    root_p, root_q = np.linalg.cholesky(p), np.linalg.cholesky(q)
    cross = correlation * root_p @ root_q.T
    for omega in np.linspace(0, 1, 6):
        information = (1 - omega) * np.linalg.inv(p) + omega * np.linalg.inv(q)
        claimed = np.linalg.inv(information)
        k, m = (1 - omega) * claimed @ np.linalg.inv(p), omega * claimed @ np.linalg.inv(q)
        if not (np.allclose(claimed, found.covariance) and np.allclose(found.motion, k @ a.motion + m @ b.motion)):
            continue
        true = k @ p @ k.T + m @ q @ m.T + k @ cross @ m.T + m @ cross.T @ k.T
        assert np.linalg.eigvalsh(claimed - true).min() > -1e-9
        return
    raise AssertionError("no share of the mixture gives what was found")


def test_two_members_of_one_camera_never_outvote_the_wheels():
    wheels = measured(0.30, 0.001, source="wheels")
    found = consensus([measured(0.10, 0.001), measured(0.1005, 0.001), wheels])
    assert found.conflict == "camera against wheels"
    assert found.motion[0] == pytest.approx(0.2, abs=1e-3)
    assert found.covariance[0, 0] == pytest.approx(0.1**2, rel=0.02), "it covers both"
    agreed = consensus([measured(0.10, 0.001), measured(0.3, 0.001), wheels])
    assert agreed.motion[0] == pytest.approx(0.30)
    assert agreed.covariance[0, 0] == pytest.approx(0.5e-6), "wheels and camera are independent"


def test_two_of_three_sources_outvote_the_third():
    gyro = MotionEstimate(np.zeros(3), np.diag([1.0, 1.0, 1e-8]), "gyro")
    spinning = MotionEstimate(np.array([0.0, 0.0, 0.3]), np.diag([1e-6, 1e-6, 1e-6]), "wheels")
    found = consensus([measured(0.10, 0.001), spinning, gyro])
    assert (found.conflict, found.motion[0]) == ("", pytest.approx(0.10, abs=1e-4))


def test_a_source_that_knows_no_translation_says_nothing_of_it_in_a_conflict():
    """Camera and gyro disagree on yaw alone: halfway there, the camera's translation."""
    gyro = MotionEstimate(np.array([0.0, 0.0, 0.2]), np.diag([1.0, 1.0, 1e-4]), "gyro")
    found = consensus([measured(0.10, 0.001), gyro])
    assert found.conflict
    assert found.motion == pytest.approx([0.099, 0.0, 0.1], abs=1e-4)
    assert found.covariance[2, 2] == pytest.approx(0.1**2 + 1e-4)


def test_independent_measurements_add_their_information_whatever_their_axes():
    random = np.random.default_rng(2)
    a, b = (part @ part.T + 0.1 * np.eye(3) for part in random.normal(0.0, 1.0, (2, 3, 3)))
    x, y = random.normal(0.0, 0.1, (2, 3))
    found = fused(MotionEstimate(x, a, "camera"), MotionEstimate(y, b, "wheels"))
    information = np.linalg.inv(a) + np.linalg.inv(b)
    assert found.covariance == pytest.approx(np.linalg.inv(information))
    expected = np.linalg.solve(information, np.linalg.solve(a, x) + np.linalg.solve(b, y))
    assert found.motion == pytest.approx(expected)


def test_what_sources_disagree_about_is_covered_around_the_middle():
    """0.1 and 0.3 m at 0.01 m: 0.2 m, with the 0.1 m to either of them on top."""
    small = np.diag([1e-4, 1e-4, 1e-4])
    camera, wheels = (MotionEstimate(np.array([x, 0.0, 0.0]), small, s) for x, s in ((0.1, "camera"), (0.3, "wheels")))
    found = consensus([camera, wheels])
    assert found.conflict == "camera against wheels"
    assert found.motion == pytest.approx([0.2, 0.0, 0.0])
    assert found.covariance == pytest.approx(np.diag([1e-4 + 0.01, 1e-4, 1e-4]))
