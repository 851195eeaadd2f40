import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from edgemap.geometry.se2 import SE2, compose_covariance
from edgemap.geometry.slam.keyframes import KeyframeTrajectory
from edgemap.geometry.trajectory_correction import TrajectoryCorrection

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


def test_loops_are_searched_with_room_for_a_slip_and_closed_by_the_odometrys_own_covariance():
    """0.3 m and 0.06 rad a keyframe, 3 frames of 1e-5 rad^2: these, or 5 % of the rotation beside them."""
    trajectory = driven(31)
    own, loose = (np.linalg.inv(trajectory.factors(loose).information[0]).diagonal() for loose in (False, True))
    assert own[2] == pytest.approx(3e-5, rel=0.05)
    assert loose[2] == pytest.approx(3e-5 + (0.05 * 0.06) ** 2, rel=0.05)
    trajectory.drop({2, 3, 7})
    assert len(trajectory.factors(True).information) == len(trajectory.factors().information) == len(trajectory) - 1
    merged = np.linalg.inv(trajectory.factors().information[1]).diagonal()
    assert merged[2] == pytest.approx(3 * own[2], rel=0.05)


def moves(stamps_s, *poses):
    count = len(poses)
    vectors = np.array([pose.vector() for pose in poses])
    return TrajectoryCorrection(np.array(stamps_s), vectors, np.zeros((count, 3)), np.zeros((count, 3, 3)))


@given(poses, poses, poses, poses)
def test_moving_twice_is_moving_once(first, second, third, there):
    early = moves([0.0, 2.0], first, second)
    late = moves([0.0, 1.0, 3.0], second, third, first)
    for stamp, expected in ((0.5, second @ first), (1.5, third @ first), (2.5, third @ second), (9.0, first @ second)):
        (found,) = early.compose(late).moved_poses([stamp], [there.vector()])
        assert SE2(*found).matrix() == pytest.approx((expected @ there).matrix(), abs=1e-9)


def test_the_past_moves_and_what_comes_after_the_solution_follows_it():
    trajectory = driven(12)
    before, covariance = [pose.vector() for pose in trajectory.poses], np.diag([0.01, 0.02, 0.003])
    assert len(before) == 4
    turned = [(SE2(0, 0, 0.5) @ SE2(*pose)).vector() for pose in before]
    solved = np.array(turned[:3])  # the fourth keyframe was made while the solver was at work
    covariances = np.array([0.2, 0.5, 1.0])[:, None, None] * covariance
    correction = trajectory.set_poses(solved, covariances, 1.1)
    np.testing.assert_allclose(correction.moved_poses([0.0, 0.3, 0.6, 0.9, 1.0], [*before, before[-1]])[:4], turned)
    assert trajectory.pose.vector() == pytest.approx((SE2(0, 0, 0.5) @ SE2(*before[-1]) @ trajectory.since).vector())
    now = trajectory.pose.vector()
    assert correction.moved_poses([1.1], [now])[0] == pytest.approx(now)  # this frame's pose is told as it is
    assert correction.poses[-1] == pytest.approx(now)
    assert np.trace(correction.covariances[-1]) > np.trace(correction.covariances[-2]) > np.trace(covariance)
    step, own = SE2(*before[2]).inverse() @ SE2(*before[3]), np.linalg.inv(trajectory.factors().information[2])
    following = compose_covariance(SE2(*solved[2]), covariance, step, own)
    np.testing.assert_allclose(correction.covariances[3], following, rtol=1e-6)


def test_what_is_dropped_leaves_the_others_where_they_are():
    complete, fewer = driven(40), driven(40)
    gone = {3, 4, 5, 9, len(complete) - 2}
    fewer.drop(gone)
    kept = [row for row in range(len(complete)) if row not in gone]
    assert fewer.stamps_s == [complete.stamps_s[row] for row in kept]
    assert [pose.vector().tolist() for pose in fewer.poses] == [complete.poses[row].vector().tolist() for row in kept]
    where, factors = SE2(), fewer.factors()
    for motion, pose in zip(factors.motions, fewer.poses[1:], strict=True):
        where = where @ SE2(*motion)
        assert where.vector() == pytest.approx(pose.vector())
    # Odometry over four motions is known worse than over one of them.
    assert np.trace(np.linalg.inv(factors.information[2])) > 3 * np.trace(
        np.linalg.inv(complete.factors().information[3])
    )


def test_headings_of_a_compass_tell_as_much_together_as_one_of_them():
    way = KeyframeTrajectory()
    way.begin(SE2(1.0, 2.0, 0.5), np.zeros((3, 3)), 0.0)
    for frame, variance in enumerate((0.04, math.inf, 0.04), 1):
        assert way.is_due(SE2(0.3, 0.0, 0.1), SPREAD)
        way.keep(frame / 10, variance)
    before = way.factors()
    assert before.headings == pytest.approx([0.5, 0.6, 0.7, 0.8])
    assert before.heading_information == pytest.approx([0.0, 12.5, 0.0, 12.5])  # together 25, as one of them
    turned = np.array([pose.vector() + [0.0, 0.0, 0.2] for pose in way.poses])
    way.set_poses(turned, np.zeros((4, 3, 3)), 0.4)
    assert way.factors().headings == pytest.approx(before.headings)  # they were measured, and stay what they were
    way.drop({1})
    assert way.factors().headings == pytest.approx([0.5, 0.7, 0.8])


def test_a_start_that_is_not_certain_is_known_as_well_as_it_is():
    way = KeyframeTrajectory()
    way.begin(SE2(3.0, -1.0, 2.0), np.diag([0.01, 0.02, 0.001]), 0.0)
    chain = way.factors()
    assert chain.first == pytest.approx([3.0, -1.0, 2.0])
    np.testing.assert_allclose(np.linalg.inv(chain.first_information), np.diag([0.01, 0.02, 0.001]), atol=1e-6)
