import math

import numpy as np
import pytest

from edgemap.evaluation.trajectory import (
    absolute_error_m,
    integrated,
    motion_errors,
    motions,
    normalised_errors,
    path_m,
    score_trajectory,
    segment_drift,
)
from edgemap.geometry.se2 import SE2

STRAIGHT = [SE2(0.1 * i, 0, 0) for i in range(101)]


def test_five_percent_too_long_is_five_percent_of_drift():
    longer = [SE2(1.05 * pose.x_m, 0, 0) for pose in STRAIGHT]
    drift = segment_drift(STRAIGHT, longer, 2.05)
    assert drift is not None
    # 21 frames of 0.1 m are the first to exceed 2.05 m: 0.105 m of error over a length of 2.05 m.
    assert drift[0] == pytest.approx(100 * 0.105 / 2.05)
    assert drift[1] == pytest.approx(0.0, abs=1e-9)


def test_a_constant_turn_is_degrees_per_metre():
    turning = integrated([SE2(0.1, 0, math.radians(0.05))] * 100)
    drift = segment_drift(STRAIGHT, turning, 0.95)
    assert drift is not None
    assert drift[1] == pytest.approx(10 * 0.05 / 0.95)


def test_a_length_that_does_not_fit_is_null():
    assert segment_drift(STRAIGHT, STRAIGHT, 11.0) is None
    figures = score_trajectory(STRAIGHT, STRAIGHT, lengths_m=(1.0, 20.0))
    assert figures["t_rel_percent"] == {"1": pytest.approx(0.0, abs=1e-9), "20": None}
    assert figures["nees"] is None


def test_the_absolute_error_is_blind_to_the_start_and_to_nothing_else():
    rng = np.random.default_rng(0)
    true = integrated([SE2(0.1, 0, float(yaw)) for yaw in rng.normal(0, 0.1, 60)])
    elsewhere = [SE2(3, -2, 1.1) @ pose for pose in true]
    assert absolute_error_m(true, elsewhere) == pytest.approx(0.0, abs=1e-9)
    bent = [SE2(pose.x_m, 0.2 * (-1) ** i, 0) for i, pose in enumerate(STRAIGHT)]
    assert absolute_error_m(STRAIGHT, bent) == pytest.approx(0.2, abs=2e-3)


def test_motions_and_poses_are_each_others_inverse():
    steps = [SE2(0.1, 0.02, 0.3), SE2(-0.1, 0, -0.2), SE2()]
    for wanted, found in zip(steps, motions(integrated(steps)), strict=True):
        np.testing.assert_allclose(found.vector(), wanted.vector(), atol=1e-12)
    assert path_m(integrated([SE2(3, 4, 1), SE2(0, 2, 0)])) == pytest.approx([0, 5, 7])


def test_yaw_errors_are_wrapped():
    assert motion_errors([SE2(0, 0, 3.1)], [SE2(0, 0, -3.1)])[0, 2] == pytest.approx(2 * math.pi - 6.2)


def test_honest_covariances_give_three():
    rng = np.random.default_rng(1)
    covariance = np.array([[4e-4, 1e-4, 0], [1e-4, 1e-4, 0], [0, 0, 1e-6]])
    errors = rng.multivariate_normal(np.zeros(3), covariance, 4000)
    nees = normalised_errors(errors, np.broadcast_to(covariance, (4000, 3, 3)))
    assert nees.mean() == pytest.approx(3.0, abs=0.15)
    assert normalised_errors(np.array([[0.02, 0, 0]]), np.diag([1e-4, 1, 1])[None]) == pytest.approx([4.0])


def test_the_papers_rmse_is_of_integrated_places_from_a_common_start():
    aside = [SE2(5, 5, 0) @ SE2(pose.x_m, 0.3, 0) for pose in STRAIGHT]
    figures = score_trajectory(STRAIGHT, [SE2(5, 5, 0), *aside[1:]])
    assert figures["paper_rmse"]["xy_m"] == pytest.approx(0.3 * math.sqrt(100 / 101))
    assert figures["rmse_left_m"] == pytest.approx(0.3 / math.sqrt(100))


def test_another_number_of_poses_is_refused():
    with pytest.raises(ValueError, match="101 true poses or motions against 100"):
        segment_drift(STRAIGHT, STRAIGHT[1:], 1.0)
