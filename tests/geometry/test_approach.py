"""Poses from which objects can be approached."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.rooms import mapped

from edgemap.geometry.errors import MapError
from edgemap.geometry.grid.occupancy_grid import OCCUPIED, OccupancyGrid
from edgemap.geometry.map_object import radius_m
from edgemap.geometry.objects.approach import ApproachRule, approach

FREE_ODDS, WALL_ODDS = -100, 100


def floor(half_m=4.0):
    """A room of free floor about the origin, 5 cm cells; unknown outside."""
    count = round(2 * half_m / 0.05)
    return OccupancyGrid(np.full((count, count), FREE_ODDS, np.int8), -half_m, -half_m, 0.05)


def walled(grid, x0, x1, y0, y1):
    """The grid with a wall in this box."""
    odds = grid.log_odds.copy()
    odds[round((y0 - grid.y_m) / 0.05) : round((y1 - grid.y_m) / 0.05),
         round((x0 - grid.x_m) / 0.05) : round((x1 - grid.x_m) / 0.05)] = WALL_ODDS  # fmt: skip
    return OccupancyGrid(odds, grid.x_m, grid.y_m, 0.05)


def test_it_stands_before_the_object_and_faces_it():
    (chair,) = mapped([("chair", 2.0, 0.0)])
    found = approach(chair, [chair], floor(), (0.0, 0.0))
    assert found.floor == "free"
    assert found.standoff_m == pytest.approx(0.4)
    assert found.pose.x_m == pytest.approx(2.0 - radius_m(chair) - 0.4 - 0.25, abs=0.01)
    assert found.pose.vector()[1:] == pytest.approx([0.0, 0.0], abs=0.01)


def test_a_front_that_a_person_has_set_goes_before_the_nearest_side():
    (couch,) = mapped([("couch", 0.0, 0.0)])
    couch = replace(couch, yaw_rad=math.pi / 2, depth_m=0.9, width_m=2.0)
    found = approach(couch, [couch], floor(), (-3.0, 0.0))
    assert found.pose.y_m == pytest.approx(0.45 + 0.4 + 0.25, abs=0.02)  # half its depth, standoff, robot
    assert abs(found.pose.x_m) < 0.2


def test_a_front_that_is_taken_costs_a_small_turn_rather_than_a_long_standoff():
    """A quarter turn costs a metre. Before the chair another one takes 0.53 m: 34 degrees aside, or 0.5 m farther."""
    chair, other = mapped([("chair", 0.0, 0.0), ("chair", 0.9, 0.0)])
    chair = replace(chair, yaw_rad=0.0, depth_m=0.5, width_m=0.5)
    found = approach(chair, [chair, other])
    assert found.standoff_m == pytest.approx(0.4)
    assert 30.0 < abs(math.degrees(math.atan2(found.pose.y_m, found.pose.x_m))) < 45.0


def test_walls_other_objects_and_unknown_floor_are_avoided():
    chair, table = mapped([("chair", 2.0, 0.0), ("dining table", 1.0, 0.0)])
    grid = walled(floor(), 2.5, 2.6, -4.0, 4.0)
    found = approach(chair, [chair, table], grid, (0.0, 0.0))
    at = np.array([found.pose.x_m, found.pose.y_m])
    assert found.pose.x_m < 2.5 - 0.25  # not behind the wall
    assert np.linalg.norm(at - table.position_m) > radius_m(table) + 0.25
    far = approach(chair, [chair, table], floor(2.0), (3.0, 0.0))  # the robot's side is unknown floor
    assert far.floor == "free"


@given(
    x=st.floats(-3.0, 3.0), y=st.floats(-3.0, 3.0), radius=st.floats(0.1, 0.5), standoff=st.floats(0.1, 0.8),
    wall=st.floats(-3.5, 3.5),
)  # fmt: skip
def test_nothing_occupied_is_ever_under_the_robot(x, y, radius, standoff, wall):
    objects = mapped([("chair", x, y), ("couch", -x, y / 2 + 1.0), ("bed", y, -x)])
    grid = walled(floor(), max(wall, -3.9), max(wall, -3.9) + 0.1, -4.0, 4.0)
    try:
        found = approach(objects[0], objects, grid, (0.0, 0.0), ApproachRule(standoff, radius))
    except MapError:
        return
    at = np.array([found.pose.x_m, found.pose.y_m])
    around = np.linspace(0.0, 2.0 * np.pi, 32)
    circle = at + 0.95 * radius * np.column_stack([np.cos(around), np.sin(around)])
    assert not (grid.at(circle) == OCCUPIED).any()
    for other in objects[1:]:
        assert np.linalg.norm(at - other.position_m) >= radius_m(other) + radius - 1e-9
    facing = objects[0].position_m - at
    assert math.cos(math.atan2(facing[1], facing[0]) - found.pose.yaw_rad) > 0.999
