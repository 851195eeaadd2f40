"""The mount's angles by the direction of motion, by turns, and by where up is seen."""

import math

import numpy as np
import pytest

from edgemap.geometry.camera.inertial import small_rotation
from edgemap.geometry.camera.mount import Mount
from edgemap.geometry.camera.mount_tilt import MountTilt, MountTiltRule
from edgemap.geometry.odometry.two_view import travelled

SIGMA_RAD = 0.001  # 0.3 px of 300


def seen_twice(random, rotation, moved_m, sigma_rad=SIGMA_RAD, count=80):
    """Rays (N, 3) to points below the lens and before it, before and after a motion."""
    points = np.column_stack(
        [random.uniform(-2, 2, count), random.uniform(-0.2, 0.8, count), random.uniform(1.5, 5, count)]
    )
    views = []
    for view in (points, (points - moved_m) @ rotation):
        noisy = view[:, :2] / view[:, 2:] + random.normal(0.0, sigma_rad, (count, 2))
        views.append(np.column_stack([noisy, np.ones(count)]))
    return views


def test_the_direction_of_motion_is_not_drawn_towards_the_points():
    random, moved_m = np.random.default_rng(0), np.array([0.02, 0.03, 0.3])
    rotation, start = small_rotation(0.01, -0.05, 0.005), small_rotation(0.0, -0.04, 0.0)
    true, errors, sigmas = moved_m / np.linalg.norm(moved_m), [], []
    for _ in range(300):
        first, second = seen_twice(random, rotation, moved_m)
        found = travelled(first, second, start, np.array([0.0, 0.0, 1.0]), SIGMA_RAD)
        errors.append((found.direction - true)[1])
        sigmas.append(math.sqrt(found.covariance[1, 1]))
    assert abs(math.degrees(np.mean(errors))) < 0.25  # 0.8 where Sampson's denominator is taken for a weight
    assert np.std(errors) == pytest.approx(np.mean(sigmas), rel=0.3)


def test_points_that_move_by_themselves_do_not_count():
    random, moved_m = np.random.default_rng(1), np.array([0.0, 0.0, 0.3])
    first, second = seen_twice(random, np.eye(3), moved_m)
    second[:12, :2] += [0.03, -0.02]
    found = travelled(first, second, np.eye(3), np.array([0.0, 0.0, 1.0]), SIGMA_RAD)
    assert math.degrees(abs(found.direction[1])) < 1.0


@pytest.mark.parametrize(("pitch_deg", "roll_deg"), [(2.0, 0.0), (-3.0, 1.0), (0.5, -2.0)])
def test_motion_and_turns_on_a_floor_give_pitch_and_roll(pitch_deg, roll_deg):
    given, true = Mount.from_degrees(0.5, 10.0), Mount.from_degrees(0.5, 10.0 + pitch_deg, roll_deg)
    by_given = given.rotation_base_optical() @ true.rotation_base_optical().T  # of base directions, as they are seen
    tilt = MountTilt.prior(MountTiltRule())
    for _ in range(20):
        tilt = tilt.by_direction(by_given @ [1.0, 0.0, 0.0], np.eye(3) * 1e-4)
    assert math.degrees(tilt.error_rad[1]) == pytest.approx(pitch_deg, abs=0.1)
    assert math.degrees(tilt.sigma_rad()[0]) > 9.0  # straight on, nothing shows the roll
    for turned_rad in (1.3, -1.2, 1.4):
        tilt = tilt.by_turn(by_given @ [0.0, 0.0, turned_rad])
    assert np.degrees(tilt.error_rad) == pytest.approx([roll_deg, pitch_deg], abs=0.15)
    assert np.degrees(tilt.sigma_rad()).max() < 0.6


def test_the_covariance_is_that_of_an_information_filter():
    """Directions ahead and to the left, up by edges, and a turn of 1 rad, with the standard deviations of the rule."""
    rule, flat = MountTiltRule(), np.array([0.6, 0.8, 0.0])
    tilt = MountTilt.prior(rule).by_direction(np.array([1.0, 0.0, 0.0]), np.eye(3) * 1e-4)
    tilt = tilt.by_direction(flat, np.eye(3) * 1e-4).by_up("edges", np.zeros(2))
    slope = np.array([[0.0, 1.0], [-0.8, 0.6]])
    expected = np.eye(2) / rule.prior**2 + slope.T @ slope / (1e-4 + rule.nod**2) + np.eye(2) / rule.seen**2
    np.testing.assert_allclose(np.linalg.inv(tilt.covariance), expected, rtol=1e-9)
    chord = math.sin(0.5) / 0.5
    expected += np.eye(2) * chord**2 / (2.0 * rule.nod**2)
    turned = tilt.by_turn(np.array([0.0, 0.0, 1.0]))
    np.testing.assert_allclose(np.linalg.inv(turned.covariance), expected, rtol=1e-9)


def test_one_wrong_witness_among_many_counts_little():
    tilt = MountTilt.prior(MountTiltRule())
    for _ in range(10):
        tilt = tilt.by_up("edges", np.radians([0.2, 1.0]))
    wrong = tilt.by_up("edges", np.radians([15.0, -20.0]))
    assert np.degrees(np.abs(wrong.error_rad - tilt.error_rad)).max() < 0.6
