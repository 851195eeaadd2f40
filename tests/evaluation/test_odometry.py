"""Errors of trajectories and odometries by hand, and by KITTI's own way of counting."""

import math

import numpy as np
import pytest

from edgemap.evaluation.odometry import INDOOR_LENGTHS_M, errors_of, figures, worst_drive
from edgemap.evaluation.trajectory import (
    aligned_errors_m,
    attitude_figures,
    integrated,
    motion_errors,
    motions,
    normalised_errors,
    path_m,
    planar_fit,
    segment_errors,
    window_errors,
)
from edgemap.geometry.camera.attitude import Attitude
from edgemap.geometry.se2 import SE2

STRAIGHT = [SE2(0.1 * i, 0, 0) for i in range(101)]


def test_a_segment_ends_at_the_first_frame_beyond_its_length_not_at_it():
    """Frames of half a metre, exact in binary: 2 m are reached at frame 4 and exceeded at frame 5, 2.5 m away."""
    true = [SE2(0.5 * i, 0, 0) for i in range(21)]
    longer = [SE2(0.55 * i, 0, 0) for i in range(21)]
    np.testing.assert_allclose(segment_errors(true, longer, 2.0, step=5)[:, 0], [0.25] * 4)
    assert len(segment_errors(true, longer, 2.0, step=1)) == 16  # starts 0 to 15
    assert len(segment_errors(true, longer, 9.5)) == 1  # frame 20 alone is farther than 9.5 m
    assert segment_errors(STRAIGHT, STRAIGHT, 11.0).shape == (0, 2)


def test_segments_agree_with_the_development_kits_way_of_counting():
    """KITTI's devkit in its own terms: 4x4 matrices, distances summed frame by frame, inv(inv(P0) P1) (inv(Q0) Q1)."""
    rng = np.random.default_rng(3)
    true = integrated([SE2(*row) for row in rng.normal([0.1, 0, 0], [0.05, 0.02, 0.2], (150, 3))])
    found = integrated([SE2(*row) for row in rng.normal([0.1, 0, 0], [0.05, 0.02, 0.2], (150, 3))])
    expected = []
    for first in range(0, len(true), 10):
        gone = 0.0
        for last in range(first + 1, len(true)):
            gone += math.dist((true[last].x_m, true[last].y_m), (true[last - 1].x_m, true[last - 1].y_m))
            if gone > 3.0:
                break
        else:
            continue
        delta_true = np.linalg.inv(true[first].matrix()) @ true[last].matrix()
        delta_found = np.linalg.inv(found[first].matrix()) @ found[last].matrix()
        error = np.linalg.inv(delta_found) @ delta_true
        expected.append((np.hypot(*error[:2, 2]), math.acos(np.clip(error[0, 0], -1, 1))))
    assert len(expected) > 8
    np.testing.assert_allclose(segment_errors(true, found, 3.0), expected, atol=1e-9)


def test_the_absolute_error_is_blind_to_the_start_and_to_nothing_else():
    rng = np.random.default_rng(0)
    true = integrated([SE2(0.1, 0, float(yaw)) for yaw in rng.normal(0, 0.1, 60)])
    elsewhere = [SE2(3, -2, 1.1) @ pose for pose in true]
    np.testing.assert_allclose(aligned_errors_m(true, elsewhere), 0.0, atol=1e-9)
    bent = [SE2(pose.x_m, 0.2 * (-1) ** i, 0) for i, pose in enumerate(STRAIGHT)]
    np.testing.assert_allclose(aligned_errors_m(STRAIGHT, bent), 0.2, atol=5e-3)


def test_motions_and_poses_are_each_others_inverse_and_yaw_errors_wrapped():
    steps = [SE2(0.1, 0.02, 0.3), SE2(-0.1, 0, -0.2), SE2()]
    for wanted, found in zip(steps, motions(integrated(steps)), strict=True):
        np.testing.assert_allclose(found.vector(), wanted.vector(), atol=1e-12)
    assert path_m(integrated([SE2(3, 4, 1), SE2(0, 2, 0)])) == pytest.approx([0, 5, 7])
    assert motion_errors([SE2(0, 0, 3.1)], [SE2(0, 0, -3.1)])[0, 2] == pytest.approx(2 * math.pi - 6.2)


def test_honest_covariances_give_three():
    rng = np.random.default_rng(1)
    covariance = np.array([[4e-4, 1e-4, 0], [1e-4, 1e-4, 0], [0, 0, 1e-6]])
    errors = rng.multivariate_normal(np.zeros(3), covariance, 4000)
    nees = normalised_errors(errors, np.broadcast_to(covariance, (4000, 3, 3)))
    assert nees.mean() == pytest.approx(3.0, abs=0.15)
    assert normalised_errors(np.array([[0.02, 0, 0]]), np.diag([1e-4, 1, 1])[None]) == pytest.approx([4.0])


def test_errors_that_last_show_in_the_nees_over_windows():
    rng = np.random.default_rng(2)
    covariances, stamps_s = np.broadcast_to(np.eye(3) * 1e-6, (4000, 3, 3)), np.arange(4001) / 10.0
    still = [SE2()] * 4001
    errors = rng.normal(0.0, 1e-3, (4000, 3))
    found = window_errors(still, integrated([SE2(*row) for row in errors]), covariances, stamps_s, (0.1, 1.0, 500.0))
    assert found[0.1].mean() == pytest.approx(3.0, abs=0.4)
    assert found[1.0].mean() == pytest.approx(3.0, abs=0.4)
    assert len(found[500.0]) == 0
    lasting = np.repeat(errors[::10], 10, axis=0)  # the same error in ten steps: ten times the variance after them
    found = window_errors(still, integrated([SE2(*row) for row in lasting]), covariances, stamps_s, (0.1, 1.0))
    assert found[0.1].mean() == pytest.approx(3.0, abs=0.4)
    assert found[1.0].mean() == pytest.approx(30.0, abs=4.0)


@pytest.mark.parametrize(("stamp_s", "whole"), [(0.995, True), (0.985, False)])
def test_a_window_may_end_a_hundredth_of_a_second_early_and_no_more(stamp_s, whole):
    """A window of a second: the step after the frame at this stamp errs, and counts where that frame came too early."""
    stamps_s = np.arange(12) / 10.0
    stamps_s[10] = stamp_s
    covariances = np.broadcast_to(np.eye(3) * 1e-6, (11, 3, 3))
    estimated = integrated([SE2()] * 10 + [SE2(0.001)])
    found = window_errors([SE2()] * 12, estimated, covariances, stamps_s, (1.0,))[1.0]
    assert found == pytest.approx([0.0] if whole else [1.0 / 11.0])


def pose(x, y, z, yaw=0.0, pitch=0.0):
    """Base to world, z up; pitch positive looking down."""
    c, s, cp, sp = math.cos(yaw), math.sin(yaw), math.cos(pitch), math.sin(pitch)
    turn = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]) @ np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]])
    full = np.eye(4)
    full[:3, :3], full[:3, 3] = turn, (x, y, z)
    return full


def test_a_hill_is_longer_than_its_shadow():
    # Up a slope of 0.1 rad with the nose along it: every motion is 1 m forward, seen from above cos(0.1).
    slope = np.array([pose(i * math.cos(0.1), 0, i * math.sin(0.1), 0, -0.1) for i in range(41)])
    fit = planar_fit(slope, (9.5, 100.0))
    assert fit["max_m"] == pytest.approx(40 * (1 - math.cos(0.1)))
    assert fit["mean_percent"] == pytest.approx(100 * 20 * (1 - math.cos(0.1)) / 40)
    assert fit["t_rel_percent"] == pytest.approx(100 * 10 * (1 - math.cos(0.1)) / 9.5)
    assert fit["height_max_m"] == pytest.approx(40 * math.sin(0.1))
    assert planar_fit(slope, (100.0,))["t_rel_percent"] is None


def score_trajectory(true, estimated, lengths_m=INDOOR_LENGTHS_M):
    """The figures of one drive."""
    return figures([errors_of(true, estimated, None, lengths_m)])


def longer(share):
    """STRAIGHT, too long by a share."""
    return [SE2((1 + share) * pose.x_m, 0, 0) for pose in STRAIGHT]


def test_drift_is_a_share_of_the_segments_length():
    found = score_trajectory(STRAIGHT, longer(0.05), lengths_m=(2.05, 20.0))
    assert found["t_rel_percent"] == {"2.05": pytest.approx(100 * 0.105 / 2.05), "20": None}
    assert found["r_rel_deg_per_m"] == {"2.05": pytest.approx(0.0, abs=1e-9), "20": None}
    assert found["t_rel_mean_percent"] == pytest.approx(100 * 0.105 / 2.05)
    turning = score_trajectory(STRAIGHT, integrated([SE2(0.1, 0, math.radians(0.05))] * 100), lengths_m=(0.95,))
    assert turning["r_rel_deg_per_m"]["0.95"] == pytest.approx(0.5 / 0.95)


def test_a_drive_too_short_for_all_lengths_has_null():
    found = score_trajectory(STRAIGHT[:3], STRAIGHT[:3])
    assert found["t_rel_percent"] == {"1": None, "2": None, "5": None}
    assert found["t_rel_mean_percent"] is None
    assert found["nees"] is None
    assert found["ate_m"] == pytest.approx(0.0, abs=1e-12)


def test_the_papers_rmse_is_of_integrated_places_from_a_common_start():
    aside = [SE2(5, 5, 0) @ SE2(pose.x_m, 0.3, 0.2) for pose in STRAIGHT]
    found = score_trajectory(STRAIGHT, [SE2(5, 5, 0), *aside[1:]])
    assert found["paper_rmse"] == pytest.approx(0.3 * math.sqrt(100 / 101))
    assert found["paper_rmse_yaw_rad"] == pytest.approx(0.2 * math.sqrt(100 / 101))
    # The first motion goes 0.3 m aside, the 99 others lead 0.2 rad to the right of where they head.
    assert found["rmse_left_m"] == pytest.approx(math.sqrt((0.3**2 + 99 * (0.1 * math.sin(0.2)) ** 2) / 100))


def test_together_every_segment_counts_once_whichever_drive_it_is_of():
    # Segments of 1.05 m end 1.1 m on; they start at frames 0, 10 ... 80 of 101, and at 0, 10, 20, 30 of 51.
    long, short = (errors_of(STRAIGHT[:n], longer(share)[:n], None, (1.05,)) for n, share in ((101, 0.1), (51, 0.2)))
    both = figures([long, short])
    assert both["segments"] == {"1.05": 13}
    assert both["t_rel_percent"]["1.05"] == pytest.approx(100 * (9 * 0.11 + 4 * 0.22) / 13 / 1.05)
    assert both["rmse_forward_m"] == pytest.approx(math.sqrt((100 * 0.01**2 + 50 * 0.02**2) / 150))
    assert both["frames"] == 152
    assert both["path_m"] == pytest.approx(15.0)


def test_lengths_of_drives_of_different_kinds_stand_side_by_side():
    room = errors_of(STRAIGHT, longer(0.1), None, (1.05,))
    road = errors_of(STRAIGHT, longer(0.1), None, (5.05, 100.0))
    assert figures([room, road])["segments"] == {"1.05": 9, "5.05": 5, "100": 0}


def test_nees_is_of_those_with_covariances():
    steps = np.broadcast_to(np.diag([1e-4, 1e-4, 1e-4]), (100, 3, 3))
    known, unknown = errors_of(STRAIGHT, longer(0.1), steps), errors_of(STRAIGHT, longer(0.2))
    assert figures([known, unknown])["nees"] == pytest.approx(1.0)  # 1 cm of error, 1 cm of sigma
    assert figures([known, unknown])["nees_median"] == pytest.approx(1.0)
    assert figures([unknown])["nees"] is None


def test_creep_is_what_is_estimated_while_nothing_moves():
    true = [
        SE2(), SE2(0.0004, 0, 0), SE2(0.0010, 0, 0), SE2(0.0010, 0, math.radians(0.02)), SE2(0.1, 0, 0), SE2(0.1, 0, 0),
    ]  # fmt: skip
    found = integrated([SE2(0.001, 0, 0), SE2(0.5, 0, 0.1), SE2(0.5, 0, 0.1), SE2(0.5, 0, 0.1), SE2(0, 0.003, -0.01)])
    still = score_trajectory(true, found)["still"]
    # The first and the last frame stand still; the second moves 0.6 mm, the third turns 0.02 degrees.
    assert still["frames"] == 2
    assert still["cm_per_frame"] == {"mean": pytest.approx(0.2), "max": pytest.approx(0.3)}
    mean_deg, max_deg = math.degrees(0.005), math.degrees(0.01)
    assert still["deg_per_frame"] == {"mean": pytest.approx(mean_deg), "max": pytest.approx(max_deg)}
    moving = score_trajectory(STRAIGHT, STRAIGHT)["still"]
    assert moving == {"frames": 0, "cm_per_frame": None, "deg_per_frame": None}


def test_the_worst_is_judged_over_the_longest_length_that_most_have():
    good, bad = (errors_of(STRAIGHT, longer(share)) for share in (0.01, 0.04))
    worst = worst_drive({"good": good, "bad": bad, "short": errors_of(STRAIGHT[:40], longer(0.03)[:40])})
    assert (worst["sequence"], worst["length_m"]) == ("bad", 2.0)
    assert worst["t_rel_percent"] == pytest.approx(4.0, rel=0.06)
    assert worst_drive({"short": errors_of(STRAIGHT[:4], STRAIGHT[:4])}) is None


def attitude(roll_deg, pitch_deg, sigma_deg=0.5, source="imu"):
    roll_rad, pitch_rad, sigma_rad = np.radians([roll_deg, pitch_deg, sigma_deg]).tolist()
    return Attitude(roll_rad, pitch_rad, np.eye(2) * sigma_rad**2, source=source)


def test_errors_by_hand():
    found = [attitude(0.0, 11.0), attitude(0.0, 9.0, source="depth"), attitude(-1.0, 10.0), None]
    figures = attitude_figures(found, [attitude(0.0, 10.0)] * 4)
    assert figures["sources"] == {"imu": 0.5, "depth": 0.25, "none": 0.25}
    assert figures["pitch_rms_deg"] == pytest.approx(math.sqrt(2.0 / 3.0))
    assert figures["roll_rms_deg"] == pytest.approx(math.sqrt(1.0 / 3.0))
    assert figures["max_deg"] == pytest.approx(1.0)
    assert figures["nees"] == pytest.approx(4.0)  # each is two standard deviations off


def test_a_turn_round_is_no_error_and_without_truth_there_are_sources_only():
    assert attitude_figures([attitude(179.5, 0.0)], [attitude(-179.5, 0.0)])["max_deg"] == pytest.approx(1.0)
    assert attitude_figures([attitude(0.0, 1.0)], None) == {
        "sources": {"imu": 1.0}, "pitch_rms_deg": None, "roll_rms_deg": None, "max_deg": None, "nees": None,
    }  # fmt: skip
