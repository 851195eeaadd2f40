"""Wheel odometry as it arrives: between poses, a little beyond them, and where it begins anew."""

import math

import pytest
from support.faults import made, texts

from edgemap.geometry.se2 import SE2
from edgemap.runtime.frames.errors import OdometryError
from edgemap.runtime.frames.trajectory import AHEAD_S, GrowingTrack
from edgemap.runtime.motion.odometry.recorded import RecordedOdometry


def track(*rows: tuple[float, float]) -> GrowingTrack:
    made = GrowingTrack()
    for stamp_s, x_m in rows:
        made.push(stamp_s, SE2(x_m, 0.0, 0.0))
    return made


def test_between_two_poses_and_beyond_the_newest():
    poses = track((10.0, 1.0), (10.05, 1.02), (10.1, 1.05))
    assert poses.at(10.025).x_m == pytest.approx(1.01)
    assert poses.at(10.1).x_m == pytest.approx(1.05)
    assert poses.at(10.2).x_m == pytest.approx(1.11)  # 0.03 m in 50 ms goes on
    for stamp_s in (9.99, 10.1 + AHEAD_S + 0.01):
        with pytest.raises(OdometryError, match=r"those that came are from 10\.000 to 10\.100 s"):
            poses.at(stamp_s)


def test_nothing_has_come():
    with pytest.raises(OdometryError, match="no pose has come yet"):
        GrowingTrack().at(1.0)


def test_a_robot_that_turns_is_carried_on_along_its_arc():
    poses = GrowingTrack()
    for index in range(3):
        angle = 0.1 * index  # on a circle of 1 m
        poses.push(0.1 * index, SE2(math.sin(angle), 1.0 - math.cos(angle), angle))
    found = poses.at(0.25)
    assert found.vector() == pytest.approx([math.sin(0.25), 1.0 - math.cos(0.25), 0.25], abs=3e-3)


def test_late_and_broken_poses_are_left_out():
    poses = track((1.0, 0.0), (1.2, 0.2), (1.1, 9.0), (1.2, 9.0), (math.nan, 9.0), (1.4, math.inf), (1.4, 0.4))
    assert poses.stamps_s.tolist() == [1.0, 1.2, 1.4]
    assert poses.at(1.3).x_m == pytest.approx(0.3)


@pytest.mark.parametrize(("stamps", "x_m"), [((1.1, 1.2, 1.3, 1.4), 0.0), ((-50.0, -49.9, -49.8, -49.7), 50.1)])
def test_odometry_that_begins_anew_is_no_motion(stamps, x_m):
    """A driver that starts again counts from zero; a clock is set back. One step is blind, the next one moves on."""
    poses = track((0.9, 50.0), (1.0, 50.1))
    odometry = RecordedOdometry(poses, "wheels")
    odometry.step_blind(1.0, made("no picture"))
    for stamp_s, moved_m in zip(stamps[:2], (0.0, 0.1), strict=True):
        poses.push(stamp_s, SE2(x_m + moved_m, 0.0, 0.0))
    blind = odometry.step_blind(stamps[1], made("no picture"))
    assert blind.blind
    assert "began again" in texts(blind.faults)
    for stamp_s, moved_m in zip(stamps[2:], (0.2, 0.3), strict=True):
        poses.push(stamp_s, SE2(x_m + moved_m, 0.0, 0.0))
    assert odometry.step_blind(stamps[2], made("no picture")).blind
    motion = odometry.step_blind(stamps[3], made("no picture"))
    assert (motion.motion.x_m, motion.blind) == (pytest.approx(0.1), False)
