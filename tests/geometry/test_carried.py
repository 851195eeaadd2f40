"""Whether a camera is carried: by how it swings, how far it went steadily, and a room's edges."""

import math
from dataclasses import replace

import pytest

from edgemap.geometry.camera.carried import Carried


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
