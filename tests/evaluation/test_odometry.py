import math

import numpy as np
import pytest

from edgemap.evaluation.odometry import INDOOR_LENGTHS_M, errors_of, figures, worst_drive
from edgemap.evaluation.trajectory import attitude_figures, integrated
from edgemap.geometry.camera.attitude import Attitude
from edgemap.geometry.se2 import SE2

STRAIGHT = [SE2(0.1 * i, 0, 0) for i in range(101)]


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
    turning = integrated([SE2(0.1, 0, math.radians(0.05))] * 100)
    assert score_trajectory(STRAIGHT, turning, lengths_m=(0.95,))["r_rel_deg_per_m"]["0.95"] == pytest.approx(
        0.5 / 0.95
    )


def test_a_drive_too_short_for_all_lengths_has_null_and_one_pose_is_refused():
    found = score_trajectory(STRAIGHT[:3], STRAIGHT[:3])
    assert found["t_rel_percent"] == {"1": None, "2": None, "5": None}
    assert found["t_rel_mean_percent"] is None
    assert found["nees"] is None
    assert found["ate_m"] == pytest.approx(0.0, abs=1e-12)
    with pytest.raises(ValueError, match="a motion needs two"):
        errors_of(STRAIGHT[:1], STRAIGHT[:1])


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
    assert still["deg_per_frame"] == {
        "mean": pytest.approx(math.degrees(0.005)),
        "max": pytest.approx(math.degrees(0.01)),
    }
    moving = score_trajectory(STRAIGHT, STRAIGHT)["still"]
    assert moving == {"frames": 0, "cm_per_frame": None, "deg_per_frame": None}


def test_the_worst_is_judged_over_the_longest_length_that_most_have():
    drives = {
        "good": errors_of(STRAIGHT, longer(0.01)),
        "bad": errors_of(STRAIGHT, longer(0.04)),
        "short": errors_of(STRAIGHT[:40], longer(0.03)[:40]),
    }
    worst = worst_drive(drives)
    assert (worst["sequence"], worst["length_m"]) == ("bad", 2.0)
    assert worst["t_rel_percent"] == pytest.approx(4.0, rel=0.06)
    assert worst_drive({"short": errors_of(STRAIGHT[:4], STRAIGHT[:4])}) is None


def attitude(roll_deg, pitch_deg, sigma_deg=0.5, source="imu"):
    return Attitude(
        math.radians(roll_deg), math.radians(pitch_deg), np.eye(2) * math.radians(sigma_deg) ** 2, source=source
    )


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
