"""The hour's laps, and what its report calls a miss; the rendering and the network are not run here."""

import math

import numpy as np
import pytest
from reliability.day import RoundTrip, drive_through
from reliability.hour import MINUTES, RecordedDrive, _report, inverted

from edgemap.geometry.se2 import SE2
from edgemap.runtime.inputs.drives import open_drive
from edgemap.runtime.inputs.open import DEMO
from edgemap.runtime.motion.odometry.protocol import Motion
from edgemap.runtime.step.config import Config
from edgemap.runtime.step.mapper import new_mapper

NEW = 40


@pytest.fixture
def laps():
    room = RoundTrip(0)
    return RecordedDrive([room.step() for _ in range(NEW)], open_drive(f"drive:{DEMO}"))


def test_the_way_back_ends_where_the_drive_began(laps):
    pose, poses = SE2(), []
    for number in range(2 * NEW - 1):
        observed = laps.step()
        if number:
            pose = pose @ observed.motion.motion
        poses.append(pose)
        assert observed.stamp_s == number / 10.0
        assert all(sighting.stamp_s == observed.stamp_s for sighting in observed.sightings)
    for there, back in zip(poses, reversed(poses), strict=True):
        np.testing.assert_allclose(there.vector(), back.vector(), atol=1e-9)
    first, second = poses[1], poses[0].inverse() @ poses[1]
    again = laps.step()
    np.testing.assert_allclose(again.motion.motion.vector(), second.vector(), atol=1e-9)
    assert math.hypot(first.x_m, first.y_m) > 0.1


def test_what_is_seen_on_the_way_back_is_what_was_seen_there(laps):
    seen = [laps.step() for _ in range(2 * NEW - 1)]
    for there, back in zip(seen, reversed(seen), strict=True):
        assert [item.label for item in there.sightings] == [item.label for item in back.sightings]
        for a, b in zip(there.sightings, back.sightings, strict=True):
            np.testing.assert_array_equal(a.position_base_m, b.position_base_m)


def test_a_motion_driven_back_is_known_as_well():
    random, covariance = np.random.default_rng(0), np.diag([0.02, 0.01, 0.03]) ** 2
    there = SE2(0.5, -0.2, 0.7)
    errors = random.multivariate_normal(np.zeros(3), covariance, 20_000)
    back = np.array([SE2(*(there.vector() + error)).inverse().vector() for error in errors])
    stated = inverted(Motion(there, covariance))
    np.testing.assert_allclose(stated.motion.vector(), there.inverse().vector())
    np.testing.assert_allclose(stated.covariance, np.cov(back.T), atol=3e-5)


def test_the_report_names_what_grows():
    even = {"p50_ms": 1.0, "p99_ms": 4.0, "rss_mb": 100.0, "largest_ms": 5.0, "objects": 9, "f1": 0.8, "long": []}
    rows = [dict(even) for _ in range(MINUTES)]
    assert _report(rows, 9, 18).failures == ()
    rows[-1] |= {"p50_ms": 1.2, "p99_ms": 9.0, "rss_mb": 150.0}
    assert [failure.split(":")[0] for failure in _report(rows, 9, 18).failures] == ["p50_ms", "p99_ms", "memory"]
    assert _report(rows[:30], 9, 18).failures[-1].startswith("the hour took too long: 30 of 60")


def test_steps_that_take_long_are_told(monkeypatch):
    monkeypatch.setattr("reliability.day.LONG_MS", 0.0)
    rows = drive_through(new_mapper(Config()), RoundTrip(0), 20, 2, 1.0, 60.0)
    assert [step["step"] for row in rows for step in row["long"]] == list(range(20))
    assert {step["stage"] for row in rows for step in row["long"]} <= {"closure", "map", "relocalisation"}
    assert rows[-1]["hour"] == 1.0
