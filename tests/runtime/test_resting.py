"""Motions within the noise wait, and none is ever lost."""

import itertools
import math

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from edgemap.geometry.se2 import SE2
from edgemap.runtime.frame import Frame
from edgemap.runtime.odometry.protocol import Motion, no_motion
from edgemap.runtime.odometry.resting import MINIMUM_M, MINIMUM_RAD, RestingOdometry

FRAME = Frame(0, 0.0, np.zeros((2, 2, 3), dtype=np.uint8))


class Given:
    """Tells the motions it was given."""

    name, needs_features = "given", False

    def __init__(self, motions):
        self._motions = iter(motions)

    def step(self, frame, features):
        return Motion(next(self._motions), np.eye(3))

    def step_blind(self, stamp_s, reason, attitude=None):
        return Motion(next(self._motions), np.eye(3), reason, blind=True)

    def still(self, stamp_s, attitude):
        return None

    def rest(self, stamp_s):
        return no_motion()

    def reset(self, reason):
        pass


def told(motions):
    resting = RestingOdometry(Given(motions))
    return [resting.step(FRAME, {}).motion for _ in motions]


def end_of(motions):
    pose = SE2()
    for motion in motions:
        pose = pose @ motion
    return pose


small = st.floats(-0.003, 0.003)


@given(st.lists(st.builds(SE2, small, small, st.floats(-0.001, 0.001)), min_size=1, max_size=60))
def test_the_end_of_the_way_is_missed_by_less_than_the_band(motions):
    missed = end_of(told(motions)).inverse() @ end_of(motions)
    assert math.hypot(missed.x_m, missed.y_m) < MINIMUM_M + 1e-9
    assert abs(missed.yaw_rad) < MINIMUM_RAD + 1e-9


def test_a_robot_at_rest_does_not_creep():
    rng = np.random.default_rng(0)
    places = rng.normal(0.0, 0.0004, (200, 2))  # landmarks hold the robot; what is measured jitters about one place
    motions = [
        SE2(float(after[0] - before[0]), float(after[1] - before[1]), 0.0)
        for before, after in itertools.pairwise(places)
    ]
    assert all(motion == SE2() for motion in told(motions))


def test_slow_motion_is_told_late_but_whole():
    slow = [SE2(0.0008, 0.0, 0.0)] * 9
    found = [motion.x_m for motion in told(slow)]
    np.testing.assert_allclose(found, [0.0, 0.0, 0.0024] * 3, atol=1e-12)


def test_a_turn_on_the_spot_is_motion():
    assert math.isclose(told([SE2(0.0, 0.0, 0.001)])[0].yaw_rad, 0.001, abs_tol=1e-12)


def test_a_reset_forgets_what_waited():
    resting = RestingOdometry(Given([SE2(0.0015, 0.0, 0.0)] * 2))
    assert resting.step(FRAME, {}).motion == SE2()
    resting.reset("gap")
    assert resting.step(FRAME, {}).motion == SE2()
