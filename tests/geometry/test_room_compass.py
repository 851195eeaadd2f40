"""The heading of a drive that drifts, held to a room whose edges are seen now and then; where edges say it is."""

import math
from dataclasses import replace

import numpy as np
import pytest

from edgemap.geometry.camera.attitude import RoomAxes
from edgemap.geometry.camera.room_edges import level_axes, room_heading
from edgemap.geometry.odometry.room_compass import VIEWS, CompassRule, RoomCompass
from edgemap.geometry.se2 import wrap_angle

STEP_S, SPAN = 0.1, 600
YAWS = 0.6 * np.sin(np.arange(SPAN) * STEP_S / 3.0) + 0.02 * np.arange(SPAN)  # it looks about and turns round
STEP_SIGMA = math.radians(0.05)
UP = np.array([0.0, -1.0, 0.0])  # of a level camera, optical frame


def driven(errors_rad, seen_rad, sigma_rad=STEP_SIGMA, rule=None):
    """Errors of the heading (N,), rad, and their stated variances: odometry errs by `errors_rad` (N,) at each step;
    every fifth step a room that lies at 0.3 rad is seen, off by `seen_rad` (N,)."""
    compass, heading = RoomCompass(rule or CompassRule()), 0.0
    compass.update(0.0, 0.0, 0.0, None)
    found, stated = [0.0], [compass.heading_rad2]
    for index in range(1, SPAN):
        stamp_s, yaw = index * STEP_S, wrap_angle(YAWS[index] - YAWS[index - 1]) + errors_rad[index]
        level_rad = 0.3 - (YAWS[index - 1] - YAWS[0]) + seen_rad[index]  # of the step before, modulo a right angle
        room = RoomAxes(level_rad % (math.pi / 2.0), math.radians(0.6), UP, stamp_s - STEP_S)
        heading += yaw + compass.update(stamp_s, yaw, sigma_rad**2, room if index % 5 == 0 else None)
        found.append(heading - (YAWS[index] - YAWS[0]))
        stated.append(compass.heading_rad2)
    return np.array(found), np.array(stated)


def views(rng, outliers=0.0):
    """Errors (N,) of what is seen: 0.6 degrees, and a share that is off by anything."""
    wild = rng.random(SPAN) < outliers
    return np.where(wild, rng.uniform(-0.7, 0.7, SPAN), rng.normal(0.0, math.radians(0.6), SPAN))


@pytest.mark.parametrize("outliers", [0.0, 0.25])
def test_a_heading_that_drifts_is_held_to_the_room(outliers):
    drift = np.full(SPAN, math.radians(6.0) / SPAN)
    found, _ = driven(drift, views(np.random.default_rng(0), outliers))
    assert np.degrees(np.abs(drift.cumsum()[-1])) == pytest.approx(6.0)
    assert np.degrees(np.abs(found)).max() < 2.5
    unknown, _ = driven(drift, views(np.random.default_rng(0)), rule=CompassRule(drift=0.0, drift_rad=0.0))
    assert np.degrees(unknown[-1]) > 5.0  # odometry that is certain of its yaw is believed


@pytest.mark.parametrize("askew_deg", [10.0, 20.0, 45.0])
def test_another_wing_of_the_building_turns_no_map(askew_deg):
    """After 20 s the robot enters a part that lies otherwise, for 40 s, and drifts there no more than before."""
    seen = views(np.random.default_rng(1))
    seen[200:] += math.radians(askew_deg)
    drift = np.full(SPAN, math.radians(6.0) / SPAN)
    assert np.degrees(np.abs(driven(drift, seen)[0])).max() < 3.0


def test_its_variance_covers_its_errors_and_stays_as_it_is_while_old_views_are_dropped():
    scaled, stated = [], []
    for seed in range(6):
        rng, step = np.random.default_rng(seed), math.radians(0.3)
        found, variances = driven(rng.normal(0.0, step, SPAN), views(rng), step)
        scaled.append(found[100:] ** 2 / variances[100:])
        stated.append(variances)
    # 0.10: the odometry's drift counts eight times, as real errors last longer than those made here.
    assert 0.05 < np.mean(scaled) < 1.0
    variances = np.array(stated)
    assert np.degrees(np.sqrt(variances[:, 20:].max())) < 5.0  # and states no more than 4.0 degrees
    assert variances[:, 300:].mean() == pytest.approx(variances[:, 20:60].mean(), rel=0.05)


def test_a_heading_that_is_lost_is_not_taken_for_another_right_angle():
    """After 60 unseen degrees, said to be 40 by standard deviation, the room is learnt again where it seems to be."""
    compass, room = RoomCompass(CompassRule()), RoomAxes(0.3, 0.01, UP, 0.0)
    compass.update(0.0, 0.0, 0.0, None)
    compass.update(1.0, 0.0, 0.0, room)
    turned = compass.update(11.0, math.radians(60.0), math.radians(40.0) ** 2, replace(room, stamp_s=11.0))
    assert turned == pytest.approx(0.0, abs=1e-6)
    assert len(compass.views) == 1


def test_its_cost_has_a_bound():
    compass = RoomCompass(CompassRule())
    for index in range(300):
        compass.update(index * STEP_S, 0.2, STEP_SIGMA**2, RoomAxes(-0.2 * index, 0.01, UP, index * STEP_S))
    assert len(compass.views) == VIEWS


@pytest.mark.parametrize("heading_deg", [0.0, 0.3, 45.0, 89.7])
def test_edges_to_either_side_of_a_heading_agree_on_it(heading_deg):
    """Six edges a degree to one side, four to the other; the heading repeats at right angles."""
    right, away = level_axes(UP)
    angles = np.radians(heading_deg + np.array([-1.0] * 6 + [1.0] * 4) + 90.0 * np.arange(10))
    along = np.outer(np.cos(angles), right) + np.outer(np.sin(angles), away)
    normals = (UP + np.cross(UP, along)) / np.sqrt(2.0)  # of planes through the lens and edges 45 degrees off
    found = np.degrees(room_heading(normals, np.ones(10), UP))
    assert abs((found - heading_deg + 45.0) % 90.0 - 45.0) < 0.8
