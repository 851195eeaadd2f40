import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from edgemap.geometry.camera.carried import Carried
from edgemap.geometry.odometry.rolling import Rolling
from edgemap.geometry.se2 import SE2

ROLLING = Rolling(share=0.01, axle_m=0.0, axle_sigma_m=0.3)


def arc(length_m: float, yaw_rad: float, axle_m: float = 0.0) -> SE2:
    """The motion of a base whose axle, so far behind it, rolls along an arc."""
    chord = length_m * float(np.sinc(yaw_rad / (2.0 * math.pi)))
    rolled = SE2(chord * math.cos(yaw_rad / 2.0), chord * math.sin(yaw_rad / 2.0), yaw_rad)
    return SE2(axle_m).inverse() @ rolled @ SE2(axle_m)


@given(st.floats(-0.2, 0.2), st.floats(-0.3, 0.3))
def test_what_rolls_has_no_lateral_part(length_m, yaw_rad):
    assert abs(ROLLING.lateral_m(arc(length_m, yaw_rad))) < 1e-12


def test_a_straight_way_teaches_no_axle_and_one_that_is_given_exactly_stays():
    assert ROLLING.observe(SE2(0.0, 0.05), 1e-6 * np.eye(3)) == ROLLING
    exact = Rolling(share=0.01, axle_m=0.1, axle_sigma_m=0.0)
    assert exact.observe(SE2(0.0, 0.05, 0.1), 1e-6 * np.eye(3)) == exact


@pytest.mark.parametrize("ahead_m", [0.27, -0.06])
def test_turns_show_how_far_the_lens_is_ahead_of_an_axle_that_no_one_measured(ahead_m):
    random, rolling = np.random.default_rng(2), Rolling(0.01, 0.0, 0.3)
    for index in range(150):
        lens = arc(0.05, 0.06 * math.sin(index / 9.0), ahead_m)
        noisy = SE2(lens.x_m, lens.y_m + random.normal(0.0, 0.003), lens.yaw_rad)
        rolling = rolling.observe(noisy, 0.003**2 * np.eye(3))
    assert rolling.axle_m == pytest.approx(ahead_m, abs=0.02)
    assert 0.004 < rolling.axle_sigma_m < 0.03


def test_a_robot_that_drives_sideways_teaches_no_axle():
    rolling = ROLLING
    for index in range(40):
        rolling = rolling.observe(SE2(0.0, 0.05, 0.004 * math.sin(index)), 0.003**2 * np.eye(3))
    assert abs(rolling.axle_m) < 0.02


def after(nods_deg, path_m=0.05, rate_hz=10.0):
    carried = Carried()
    for nod_deg in nods_deg:
        carried = carried.updated(math.radians(nod_deg) ** 2, 1.0 / rate_hz, path_m)
    return carried


@pytest.mark.parametrize(("nod_deg", "needed_m"), [(0.15, 0.5), (0.45, 2.0)])
def test_a_robot_that_nods_a_little_is_on_wheels_soon_and_one_that_nods_more_after_two_metres(nod_deg, needed_m):
    steps = round(needed_m / 0.05)
    assert not after([nod_deg] * (steps - 1)).on_wheels
    robot = after([nod_deg] * (steps + 1))
    assert robot.on_wheels
    assert robot.share == 0.0
    assert robot.nodding_rad <= robot.nod_rad
    assert not replace(robot, scattered=True).on_wheels
    assert replace(robot, scattered=True).share == 1.0


def test_a_head_that_swings_is_carried_and_one_swing_ends_a_steady_way():
    head = after([1.7] * 60)
    assert head.share == 1.0
    assert head.nodding_rad - head.nod_rad == pytest.approx(math.radians(1.1), rel=0.01)
    assert not head.on_wheels
    assert not after([0.25] * 60 + [3.0]).on_wheels


def test_a_rate_is_of_time_and_a_nod_of_pictures():
    slow, fast = after([0.4] * 50, rate_hz=5.0), after([0.4] * 50, rate_hz=30.0)
    assert slow.share == 0.0
    assert fast.share == 1.0
    assert slow.nodding2 == fast.nodding2
    assert after([3.0, 0.0, 0.0], rate_hz=0.1).share == 0.0  # pictures farther than its averaging window
