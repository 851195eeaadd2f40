import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from edgemap.geometry.se2 import SE2
from edgemap.geometry.slam.keyframes import KeyframeRule, KeyframeTrajectory, TrajectoryCorrection

STEP, SPREAD = SE2(0.1, 0.0, 0.02), np.diag([1e-5, 1e-5, 1e-5])
poses = st.builds(SE2, st.floats(-5, 5), st.floats(-5, 5), st.floats(-3, 3))


def driven(frames, rule=None):
    way = KeyframeTrajectory(rule)
    way.begin(SE2(), np.zeros((3, 3)), 0.0)
    for frame in range(1, frames):
        if way.is_due(STEP, SPREAD):
            way.keep(frame / 10)
    return way


def test_a_keyframe_every_quarter_metre_and_the_pose_between_them():
    way = driven(31)
    assert way.stamps_s == pytest.approx([0.0, 0.3, 0.6, 0.9, 1.2, 1.5, 1.8, 2.1, 2.4, 2.7, 3.0])
    where = SE2()
    for _ in range(30):
        where = where @ STEP
    assert way.pose.vector() == pytest.approx(where.vector())
    assert way.odometer_m == pytest.approx(30 * (0.1 + 0.02))


def test_turning_on_the_spot_makes_keyframes_too():
    way = KeyframeTrajectory()
    way.begin(SE2(), np.zeros((3, 3)), 0.0)
    due = [way.is_due(SE2(0, 0, 0.1), SPREAD) for _ in range(3)]
    assert due == [False, False, True]


@given(poses, poses, poses, poses)
def test_moving_twice_is_moving_once(first, second, third, there):
    early = TrajectoryCorrection(np.array([0.0, 2.0]), np.array([first.vector(), second.vector()]))
    late = TrajectoryCorrection(np.array([0.0, 1.0, 3.0]), np.array([second.vector(), third.vector(), first.vector()]))
    for stamp, expected in ((0.5, second @ first), (1.5, third @ first), (2.5, third @ second), (9.0, first @ second)):
        (found,) = early.then(late).poses([stamp], [there.vector()])
        assert SE2(*found).matrix() == pytest.approx((expected @ there).matrix(), abs=1e-9)
        (point,) = early.then(late).points([stamp], [[there.x_m, there.y_m]])
        assert point == pytest.approx(found[:2])


def test_the_past_moves_and_the_present_keyframe_is_new():
    way = driven(10)
    before = [pose.vector() for pose in way.poses]
    turned = [(SE2(0, 0, 0.5) @ SE2(*pose)).vector() for pose in before]
    past = way.put(np.array(turned))
    np.testing.assert_allclose(past.poses(way.stamps_s[:-1], before[:-1]), turned[:-1])
    assert past.poses([way.stamps_s[-1]], [turned[-1]])[0] == pytest.approx(turned[-1])


def test_thinning_out_keeps_ends_and_places():
    whole, thin = driven(40), driven(40)
    homes = thin.thinned()
    assert len(thin) < len(whole)
    assert thin.pose.vector() == pytest.approx(whole.pose.vector())
    for old, (home, place) in enumerate(homes):
        assert (thin.poses[home] @ place).vector() == pytest.approx(whole.poses[old].vector())
    where = SE2()
    for motion, pose in zip(thin.chain().motions, thin.poses[1:], strict=True):
        where = where @ SE2(*motion)
        assert where.vector() == pytest.approx(pose.vector())


def test_odometry_that_says_it_is_certain_is_not_believed():
    way = driven(40, KeyframeRule(per_metre=0.03, still_m=0.0))
    sigma_m = 1.0 / np.sqrt(np.linalg.inv(np.linalg.inv(way.chain().information[0]))[0, 0])
    assert sigma_m >= 0.03 * 0.3


def test_a_start_that_is_not_certain_is_known_as_well_as_it_is():
    way = KeyframeTrajectory()
    way.begin(SE2(3.0, -1.0, 2.0), np.diag([0.01, 0.02, 0.001]), 0.0)
    chain = way.chain()
    assert chain.first == pytest.approx([3.0, -1.0, 2.0])
    np.testing.assert_allclose(np.linalg.inv(chain.first_information), np.diag([0.01, 0.02, 0.001]), atol=1e-6)
