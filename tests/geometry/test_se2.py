import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

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


def test_wrap_keeps_plus_pi():
    assert wrap_angle(math.pi) == math.pi
    assert wrap_angle(-math.pi) == math.pi


@given(poses, poses, poses)
def test_composition_is_that_of_matrices_and_associative(a, b, c):
    np.testing.assert_allclose((a @ b).matrix(), a.matrix() @ b.matrix(), atol=1e-9)
    np.testing.assert_allclose(((a @ b) @ c).matrix(), (a @ (b @ c)).matrix(), atol=1e-9)


@given(poses)
def test_inverse_undoes(pose):
    np.testing.assert_allclose((pose @ pose.inverse()).matrix(), np.eye(3), atol=1e-9)


def test_a_point_ahead_of_a_robot_that_turned_left_is_on_the_left():
    assert SE2(1.0, 2.0, math.pi / 2).apply([1.0, 0.0]) == pytest.approx([1.0, 3.0])


@given(poses, poses)
def test_interpolation_ends_where_it_should(a, b):
    np.testing.assert_allclose(a.interpolate(b, 0.0).matrix(), a.matrix(), atol=1e-9)
    np.testing.assert_allclose(a.interpolate(b, 1.0).matrix(), b.matrix(), atol=1e-9)


def test_interpolation_takes_the_shorter_turn():
    middle = SE2(0, 0, math.radians(170)).interpolate(SE2(0, 0, math.radians(-170)), 0.5)
    assert abs(middle.yaw_rad) == pytest.approx(math.pi)


def test_covariance_of_a_composition_matches_sampling():
    rng = np.random.default_rng(1)
    pose, motion = SE2(1.0, -2.0, 0.7), SE2(0.5, 0.1, 0.2)
    p = np.diag([0.02, 0.03, 0.02]) ** 2 + 1e-5
    q = np.diag([0.01, 0.02, 0.01]) ** 2
    samples = np.array(
        [
            (SE2(*(pose.vector() + a)) @ SE2(*(motion.vector() + b))).vector()
            for a, b in zip(
                rng.multivariate_normal(np.zeros(3), p, 20000),
                rng.multivariate_normal(np.zeros(3), q, 20000),
                strict=True,
            )
        ]
    )
    np.testing.assert_allclose(compose_covariance(pose, p, motion, q), np.cov(samples.T), rtol=0.06, atol=1.5e-5)


def test_a_pose_holds_plain_floats_whatever_it_was_given():
    """They go to JSON and are compared bit for bit."""
    pose = SE2(*np.array([1.5, 2.0, 7.0]))
    assert [type(value) for value in (pose.x_m, pose.y_m, pose.yaw_rad)] == [float] * 3
