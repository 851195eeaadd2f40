"""The pose graph and its keyframes, against scipy and sums by hand."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import least_squares
from support.units import ended

from edgemap.geometry.arrays import inverse
from edgemap.geometry.se2 import SE2, compose_covariance
from edgemap.geometry.slam import least_squares as graph
from edgemap.geometry.slam.keyframes import KeyframeTrajectory
from edgemap.geometry.slam.least_squares import ObservationFactors, OdometryFactors, Problem

FIXED = np.eye(3) * 1e8
AT_REST = OdometryFactors(np.zeros((0, 3)), np.zeros((0, 3, 3)), np.zeros(3), FIXED, 0.0, np.zeros(1), np.zeros(1))


def observations(places=(), information=1.0, pose=None, landmark=None, bias_m=(0.0, 0.0)):
    """Of places (N, 2), from the first pose and of the first landmark by default; the other values hold for each."""
    count = len(places)
    first = np.zeros(count, dtype=np.intp)
    return ObservationFactors(
        first if pose is None else pose, first if landmark is None else landmark, np.reshape(places, (-1, 2)),
        np.tile(np.eye(2) * information, (count, 1, 1)), np.tile(bias_m, (count, 1)),
    )  # fmt: skip


def solve(poses, landmarks, chain, looks, known=0.0, kernel=9.0, rounds=6, freedom=math.inf):
    """The solution, whatever the units of work. known: information of each landmark's place."""
    landmarks = np.reshape(np.asarray(landmarks, dtype=float), (-1, 2))
    priors = np.tile(np.eye(2) * known, (len(landmarks), 1, 1))
    return ended(graph.solve(Problem(chain, looks, landmarks, priors, kernel, freedom), poses, np.zeros(3), rounds))


def drive(seed=0, count=9):
    """A noisy drive past three landmarks: start values, chain and looks."""
    random = np.random.default_rng(seed)
    pose, poses, motions = SE2(0.5, -1.0, 0.3), [SE2(0.5, -1.0, 0.3)], []
    for _ in range(count - 1):
        motion = SE2(random.uniform(0.1, 0.4), random.normal(0.0, 0.05), random.normal(0.0, 0.4))
        pose = pose @ motion
        poses.append(pose)
        motions.append(motion.vector() + random.normal(0.0, 0.03, 3))
    landmarks = random.uniform(-3.0, 3.0, (3, 2))
    rows = [(k, j) for k in range(count) for j in range(3) if (k + j) % 2]
    looks = ObservationFactors(
        np.array([k for k, _ in rows]), np.array([j for _, j in rows]),
        np.array([poses[k].inverse().apply(landmarks[j]) + random.normal(0.0, 0.1, 2) for k, j in rows]),
        inverse(np.array([np.diag([0.01, 0.02]) + 0.003 for _ in rows])),
        random.normal(0.0, 0.1, (len(rows), 2)),
    )  # fmt: skip
    information = inverse(np.array([np.diag([9e-4, 9e-4, 9e-4]) + 1e-4 for _ in motions]))
    start = np.array([p.vector() for p in poses]) + random.normal(0.0, 0.05, (count, 3))
    start[0] = poses[0].vector()
    headings = np.array([p.yaw_rad for p in poses]) + random.normal(0.0, 0.02, count)
    known = np.where(np.arange(count) % 3 == 0, 0.0, random.uniform(100.0, 2500.0, count))
    chain = OdometryFactors(np.array(motions), information, start[0], FIXED, 0.08, headings, known)
    return start, landmarks + random.normal(0.0, 0.2, (3, 2)), chain, looks


def residuals(x, count, chain, looks):
    """The same problem written with SE2 and whitened, for scipy."""
    poses, landmarks = x[: 3 * count].reshape(-1, 3), x[3 * count : -3].reshape(-1, 2)
    found = [math.sqrt(FIXED[0, 0]) * (poses[0] - chain.first)]
    for k, (motion, information) in enumerate(zip(chain.motions, chain.information, strict=True)):
        relative = SE2(*poses[k]).inverse() @ SE2(*poses[k + 1])
        off = relative.vector() - motion * (1 + 0.08 * x[[-3, -3, -2]])
        off[2] = math.remainder(off[2], math.tau)
        found.append(np.linalg.cholesky(information).T @ off)
    off = [math.remainder(yaw_rad, math.tau) for yaw_rad in poses[:, 2] - chain.headings]
    found.append(np.sqrt(chain.heading_information) * off)
    found.append(x[-3:])  # errors of odometry and of the mount, in their standard deviations
    rows = zip(looks.pose, looks.landmark, looks.position_m, looks.information, looks.bias_m, strict=True)
    for k, j, place, information, bias in rows:
        off = SE2(*poses[k]).inverse().apply(landmarks[j]) + x[-1] * bias - place
        found.append(np.linalg.cholesky(information).T @ off)
    return np.concatenate(found)


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_the_least_squares_are_scipys(seed):
    start, landmarks, chain, looks = drive(seed)
    ours = solve(start, landmarks, chain, looks, kernel=1e12, rounds=30)
    count = len(start)
    x = np.concatenate([start.ravel(), landmarks.ravel(), np.zeros(3)])
    theirs = least_squares(residuals, x, args=(count, chain, looks), xtol=1e-14, ftol=1e-14, gtol=1e-12)
    np.testing.assert_allclose(ours.poses, theirs.x[: 3 * count].reshape(-1, 3), atol=1e-4)
    np.testing.assert_allclose(ours.landmarks, theirs.x[3 * count : -3].reshape(-1, 2), atol=1e-4)
    covariance = np.linalg.inv(theirs.jac.T @ theirs.jac)
    assert ours.biases == pytest.approx(theirs.x[-3:], abs=1e-3)
    landmark = slice(3 * count, 3 * count + 6)
    np.testing.assert_allclose(ours.landmark_covariance, covariance[landmark, landmark], rtol=0.03, atol=1e-5)
    stated = np.delete(theirs.jac, [-3, -2], axis=1)  # poses by the odometry as it states itself
    covariance = np.linalg.inv(stated.T @ stated)
    found = ended(ours.pose_covariances())
    for pose in range(count):
        own = slice(3 * pose, 3 * pose + 3)
        np.testing.assert_allclose(found[pose], covariance[own, own], rtol=0.03, atol=1e-5)


def test_the_evidence_is_the_likelihood_of_what_was_measured_with_all_unknowns_integrated_out():
    """One landmark observed twice, with a prior or without: the ratio to nothing observed is the density of how far
    what was measured is apart, a Gaussian's; one observation alone of a landmark without a prior is no evidence."""
    nothing = solve(np.zeros((1, 3)), np.zeros((0, 2)), AT_REST, observations(), 0.0, math.inf, 9).log_evidence
    places, own_m2 = np.array([[0.0, 0.0], [0.3, 0.1]]), 0.02
    cases = (0.0, places, 2 * own_m2), (100.0, places[1:], own_m2 + 0.01), (0.0, places[1:], None)
    for known, seen, apart_m2 in cases:
        found = solve(
            np.zeros((1, 3)), places[:1], AT_REST, observations(seen, 1.0 / own_m2), known,
            math.inf, 9,
        )  # fmt: skip
        expected = 0.0
        if apart_m2 is not None:
            expected = -math.log(2 * math.pi * apart_m2) - 0.5 * (0.3**2 + 0.1**2) / apart_m2
        assert found.log_evidence - nothing == pytest.approx(expected, abs=1e-6)


def test_a_slip_is_found_where_it_happened():
    """Odometry that is good to a millimetre misses half a metre once; two known landmarks say so from both ends."""
    motions = np.tile([0.2, 0.0, 0.0], (8, 1))
    true = np.column_stack([np.cumsum([0.0, *motions[:, 0]]), np.zeros(9), np.zeros(9)])
    true[5:, 0] += 0.5
    none = np.zeros(9)
    chain = OdometryFactors(motions, np.tile(np.eye(3) * 1e6, (8, 1, 1)), np.zeros(3), FIXED, 0.0, none, none)
    places = np.array([[2.0, 1.0], [2.0, -1.0]])
    observed = np.concatenate([SE2(*pose).inverse().apply(places) for pose in true])
    looks = observations(observed, 400.0, np.repeat(np.arange(9), 2), np.tile([0, 1], 9))
    start = np.column_stack([np.cumsum([0.0, *motions[:, 0]]), np.zeros((9, 2))])
    gaussian = solve(start, places, chain, looks, 1e4, math.inf, 40)
    heavy = solve(true, places, chain, looks, 1e4, math.inf, 40, freedom=4.0)
    assert np.abs(heavy.poses - true)[:, 0].max() < 0.03
    assert np.abs(gaussian.poses - true)[:, 0].max() > 0.2
    assert heavy.log_evidence > gaussian.log_evidence + 100


def test_one_look_at_a_known_landmark_is_a_kalman_update():
    # The pose may be 0.2 m off along x and y, the landmark 0.1 m, the look 0.1 m: it says 0.3 m less in x. One round
    # solves what is linear, a second one confirms it.
    chain = replace(AT_REST, first_information=np.diag([25.0, 25.0, 1e12]))
    start, seen = (np.zeros((1, 3)), [(2.0, 0.0)], chain), [observations([(x_m, 0.0)], 100.0) for x_m in (2.0, 1.7)]
    expected, found = (solve(*start, each, 100.0, kernel=1e9, rounds=2) for each in seen)
    assert found.poses[0] == pytest.approx([0.3 * 0.04 / 0.06, 0.0, 0.0], abs=1e-6)
    assert found.landmarks[0] == pytest.approx([2.0 - 0.3 * 0.01 / 0.06, 0.0], abs=1e-6)
    assert ended(found.pose_covariances())[0, 0, 0] == pytest.approx(1.0 / (25.0 + 1.0 / 0.02), rel=1e-4)
    assert found.log_evidence - expected.log_evidence == pytest.approx(-0.5 * 0.3**2 / 0.06, abs=1e-3)


def test_a_robust_kernel_charges_less_for_a_residual_of_three_standard_deviations():
    """Pose and landmark are fixed, 0.3 m from what a look of 0.1 m says: 9 / 2, or 9 / 2 log(1 + 9 / 9)."""
    looks = observations([(1.7, 0.0)], 100.0)
    chain = replace(AT_REST, first_information=np.eye(3) * 1e10)
    problem = np.zeros((1, 3)), [(2.0, 0.0)], chain, looks, 1e10
    robust, gaussian = (solve(*problem, kernel).log_evidence for kernel in (9.0, math.inf))
    assert robust - gaussian == pytest.approx(4.5 - 4.5 * math.log(2.0), abs=1e-3)


STEP, SPREAD = SE2(0.1, 0.0, 0.02), np.diag([1e-5, 1e-5, 1e-5])


def driven(frames, rule=None):
    way = KeyframeTrajectory(rule)
    way.begin(SE2(), np.zeros((3, 3)), 0.0)
    for frame in range(1, frames):
        way.advance(STEP, SPREAD, frame / 10)
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


def test_the_past_moves_and_what_comes_after_the_solution_follows_it():
    trajectory = driven(12)
    before, covariance = trajectory.poses, np.diag([0.01, 0.02, 0.003])
    assert len(before) == 4
    turned = [(SE2(0, 0, 0.5) @ SE2(*pose)).vector() for pose in before]
    solved = np.array(turned[:3])  # the fourth keyframe was made while the solver was at work
    covariances = np.array([0.2, 0.5, 1.0])[:, None, None] * covariance
    correction = trajectory.set_poses(solved, covariances)
    np.testing.assert_allclose(correction.moved_poses([0.0, 0.3, 0.6, 0.9, 1.0], [*before, before[-1]])[:4], turned)
    assert trajectory.pose.vector() == pytest.approx((SE2(0, 0, 0.5) @ SE2(*before[-1]) @ trajectory.since).vector())
    now = trajectory.pose.vector()
    assert correction.moved_poses([1.1], [now])[0] == pytest.approx(now)  # this frame's pose is told as it is
    assert np.trace(trajectory.covariance) > np.trace(trajectory.covariances[-1]) > np.trace(covariance)
    step, own = SE2(*before[2]).inverse() @ SE2(*before[3]), np.linalg.inv(trajectory.factors().information[2])
    following = compose_covariance(SE2(*solved[2]), covariance, step, own)
    np.testing.assert_allclose(trajectory.covariances[3], following, rtol=1e-6)


def test_what_is_dropped_leaves_the_others_where_they_are():
    complete, fewer = driven(40), driven(40)
    gone = {3, 4, 5, 9, len(complete) - 2}
    fewer.drop(gone)
    kept = [row for row in range(len(complete)) if row not in gone]
    assert fewer.stamps_s.tolist() == complete.stamps_s[kept].tolist()
    assert fewer.poses.tolist() == complete.poses[kept].tolist()
    where, factors = SE2(), fewer.factors()
    for motion, pose in zip(factors.motions, fewer.poses[1:], strict=True):
        where = where @ SE2(*motion)
        assert where.vector() == pytest.approx(pose)
    # Odometry over four motions is known worse than over one of them.
    four, one = factors.information[2], complete.factors().information[3]
    assert np.trace(np.linalg.inv(four)) > 3 * np.trace(np.linalg.inv(one))


def test_headings_of_a_compass_tell_as_much_together_as_one_of_them():
    way = KeyframeTrajectory()
    way.begin(SE2(1.0, 2.0, 0.5), np.zeros((3, 3)), 0.0)
    for frame, variance in enumerate((0.04, math.inf, 0.04), 1):
        assert way.advance(SE2(0.3, 0.0, 0.1), SPREAD, frame / 10, variance)
    before = way.factors()
    assert before.headings == pytest.approx([0.5, 0.6, 0.7, 0.8])
    assert before.heading_information == pytest.approx([0.0, 12.5, 0.0, 12.5])  # together 25, as one of them
    turned = way.poses + [0.0, 0.0, 0.2]
    way.set_poses(turned, np.zeros((4, 3, 3)))
    assert way.factors().headings == pytest.approx(before.headings)  # they were measured, and stay what they were
    way.drop({1})
    assert way.factors().headings == pytest.approx([0.5, 0.7, 0.8])


def test_a_start_that_is_not_certain_is_known_as_well_as_it_is():
    way = KeyframeTrajectory()
    way.begin(SE2(3.0, -1.0, 2.0), np.diag([0.01, 0.02, 0.001]), 0.0)
    chain = way.factors()
    assert chain.first == pytest.approx([3.0, -1.0, 2.0])
    np.testing.assert_allclose(np.linalg.inv(chain.first_information), np.diag([0.01, 0.02, 0.001]), atol=1e-6)
