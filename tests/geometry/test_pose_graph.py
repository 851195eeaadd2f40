import math

import numpy as np
import pytest
from scipy.optimize import least_squares

from edgemap.geometry.se2 import SE2
from edgemap.geometry.slam.least_squares import LandmarkPriors, ObservationFactors, OdometryFactors, inverse, solve

FIXED = np.eye(3) * 1e8
NOTHING = LandmarkPriors(np.zeros((3, 2)), np.zeros((3, 2, 2)))


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
    )  # fmt: skip
    information = inverse(np.array([np.diag([9e-4, 9e-4, 9e-4]) + 1e-4 for _ in motions]))
    start = np.array([p.vector() for p in poses]) + random.normal(0.0, 0.05, (count, 3))
    start[0] = poses[0].vector()
    chain = OdometryFactors(np.array(motions), information, start[0], FIXED)
    return start, landmarks + random.normal(0.0, 0.2, (3, 2)), chain, looks


def residuals(x, count, chain, looks):
    """The same problem written with SE2 and whitened, for scipy."""
    poses, landmarks = x[: 3 * count].reshape(-1, 3), x[3 * count :].reshape(-1, 2)
    found = [math.sqrt(FIXED[0, 0]) * (poses[0] - chain.first)]
    for k, (motion, information) in enumerate(zip(chain.motions, chain.information, strict=True)):
        relative = SE2(*poses[k]).inverse() @ SE2(*poses[k + 1])
        off = relative.vector() - motion
        off[2] = math.remainder(off[2], math.tau)
        found.append(np.linalg.cholesky(information).T @ off)
    for k, j, place, information in zip(looks.pose, looks.landmark, looks.place_m, looks.information, strict=True):
        found.append(np.linalg.cholesky(information).T @ (SE2(*poses[k]).inverse().apply(landmarks[j]) - place))
    return np.concatenate(found)


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_the_least_squares_are_scipys(seed):
    start, landmarks, chain, looks = drive(seed)
    ours = solve(start, landmarks, chain, looks, NOTHING, kernel=1e12, rounds=30)
    count = len(start)
    x = np.concatenate([start.ravel(), landmarks.ravel()])
    theirs = least_squares(residuals, x, args=(count, chain, looks), xtol=1e-14, ftol=1e-14, gtol=1e-12)
    np.testing.assert_allclose(ours.poses, theirs.x[: 3 * count].reshape(-1, 3), atol=1e-4)
    np.testing.assert_allclose(ours.landmarks, theirs.x[3 * count :].reshape(-1, 2), atol=1e-4)
    covariance = np.linalg.inv(theirs.jac.T @ theirs.jac)
    np.testing.assert_allclose(ours.covariance, covariance[3 * count :, 3 * count :], rtol=0.03, atol=1e-5)
    last = slice(3 * count - 3, 3 * count)
    np.testing.assert_allclose(ours.last_covariance, covariance[last, last], rtol=0.03, atol=1e-5)


def test_one_look_at_a_known_landmark_is_a_kalman_update():
    # The pose may be 0.2 m off along x and y, the landmark 0.1 m, the look 0.1 m: it says 0.3 m less in x.
    chain = OdometryFactors(np.zeros((0, 3)), np.zeros((0, 3, 3)), np.zeros(3), np.diag([25.0, 25.0, 1e12]))
    looks = ObservationFactors(np.array([0]), np.array([0]), np.array([[1.7, 0.0]]), np.eye(2)[None] * 100.0)
    known = LandmarkPriors(np.array([[2.0, 0.0]]), np.eye(2)[None] * 100.0)
    found = solve(np.zeros((1, 3)), known.place_m, chain, looks, known, kernel=1e9)
    assert found.poses[0] == pytest.approx([0.3 * 0.04 / 0.06, 0.0, 0.0], abs=1e-6)
    assert found.landmarks[0] == pytest.approx([2.0 - 0.3 * 0.01 / 0.06, 0.0], abs=1e-6)
    assert found.last_covariance[0, 0] == pytest.approx(1.0 / (25.0 + 1.0 / 0.02), rel=1e-4)


def test_an_outlier_weighs_little():
    start, landmarks, chain, looks = drive(3)
    clean = solve(start, landmarks, chain, looks, NOTHING)
    places = looks.place_m.copy()
    places[4] += [2.0, -1.0]
    wrong = ObservationFactors(looks.pose, looks.landmark, places, looks.information)
    robust = solve(start, landmarks, chain, wrong, NOTHING)
    trusting = solve(start, landmarks, chain, wrong, NOTHING, kernel=1e12)
    off, far = (np.abs(found.poses - clean.poses).max() for found in (robust, trusting))
    assert off < 0.25 * far
    assert robust.chi2.argmax() == 4


def test_a_way_without_landmarks_stays_as_it_was_driven():
    start, _, chain, _ = drive(4)
    nothing = ObservationFactors(np.zeros(0, int), np.zeros(0, int), np.zeros((0, 2)), np.zeros((0, 2, 2)))
    found = solve(start, np.zeros((0, 2)), chain, nothing, LandmarkPriors(np.zeros((0, 2)), np.zeros((0, 2, 2))))
    pose = SE2(*chain.first)
    for motion, where in zip(chain.motions, found.poses[1:], strict=True):
        pose = pose @ SE2(*motion)
        assert where == pytest.approx(pose.vector(), abs=1e-6)
