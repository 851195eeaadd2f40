"""Planar poses, their covariances, and what several sources say of one."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from edgemap.geometry.odometry.consensus import MotionEstimate, consensus, fused
from edgemap.geometry.se2 import SE2, compose_covariance, wrap_angle

metres = st.floats(-50, 50)
angles = st.floats(-20, 20)
poses = st.builds(SE2, metres, metres, angles)


@given(angles)
def test_wrapped_angle_is_the_same_direction_in_half_open_range(angle):
    wrapped = wrap_angle(angle)
    assert -math.pi < wrapped <= math.pi
    assert math.cos(wrapped) == pytest.approx(math.cos(angle), abs=1e-9)
    assert math.sin(wrapped) == pytest.approx(math.sin(angle), abs=1e-9)


def test_poses_by_hand():
    assert wrap_angle(math.pi) == math.pi
    assert wrap_angle(-math.pi) == math.pi
    assert SE2(1.0, 2.0, math.pi / 2).apply([1.0, 0.0]) == pytest.approx([1.0, 3.0])
    middle = SE2(0, 0, math.radians(170)).interpolate(SE2(0, 0, math.radians(-170)), 0.5)
    assert abs(middle.yaw_rad) == pytest.approx(math.pi)
    # They go to JSON and are compared bit for bit.
    pose = SE2(*np.array([1.5, 2.0, 7.0]))
    assert [type(value) for value in (pose.x_m, pose.y_m, pose.yaw_rad)] == [float] * 3


@given(poses, poses, poses)
def test_composition_is_that_of_matrices_and_associative_and_the_inverse_undoes(a, b, c):
    np.testing.assert_allclose((a @ b).matrix(), a.matrix() @ b.matrix(), atol=1e-9)
    np.testing.assert_allclose(((a @ b) @ c).matrix(), (a @ (b @ c)).matrix(), atol=1e-9)
    np.testing.assert_allclose((a @ a.inverse()).matrix(), np.eye(3), atol=1e-9)


@given(poses, poses)
def test_interpolation_ends_where_it_should(a, b):
    np.testing.assert_allclose(a.interpolate(b, 0.0).matrix(), a.matrix(), atol=1e-9)
    np.testing.assert_allclose(a.interpolate(b, 1.0).matrix(), b.matrix(), atol=1e-9)


def test_covariance_of_a_composition_matches_sampling():
    rng = np.random.default_rng(1)
    pose, motion = SE2(1.0, -2.0, 0.7), SE2(0.5, 0.1, 0.2)
    p = np.diag([0.02, 0.03, 0.02]) ** 2 + 1e-5
    q = np.diag([0.01, 0.02, 0.01]) ** 2
    moves = zip(*(rng.multivariate_normal(np.zeros(3), one, 20000) for one in (p, q)), strict=True)
    samples = np.array([(SE2(*(pose.vector() + a)) @ SE2(*(motion.vector() + b))).vector() for a, b in moves])
    np.testing.assert_allclose(compose_covariance(pose, p, motion, q), np.cov(samples.T), rtol=0.06, atol=1.5e-5)


def measured(x_m, sigma_m=0.01):
    return MotionEstimate(np.array([x_m, 0.0, 0.0]), np.diag([sigma_m**2, sigma_m**2, 0.01**2]))


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
