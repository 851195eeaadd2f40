"""Questions to a map: nearest, inside, zones; footprints, and places to approach an object from."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.rooms import mapped

from edgemap.geometry.errors import MapError
from edgemap.geometry.grid.occupancy_grid import OCCUPIED, OccupancyGrid
from edgemap.geometry.map_object import MapObject, ObjectFootprint, outline_m, radius_m
from edgemap.geometry.objects.annotations import Zone
from edgemap.geometry.objects.approach import ApproachRule, approach
from edgemap.geometry.objects.footprint import FootprintRule, fitted
from edgemap.geometry.objects.merge import fused
from edgemap.geometry.objects.queries import inside_polygon
from edgemap.geometry.objects.zone_watch import ZoneWatch
from edgemap.geometry.se2 import wrap_angle
from edgemap.geometry.slam.object_landmarks import LandmarkRule
from edgemap.runtime.step.map_file import map_document, read_map, saved_text


def item(identity, x, y, last_s=1.0):
    label = identity.rpartition("-")[0]
    return MapObject(identity, label, np.array([x, y], float), np.eye(2), 0.5, 0.9, 9, 1.0, 0.0, last_s)


ROOM = [item("chair-1", 3, 0, 5.0), item("couch-1", 1, 1, 9.0), item("chair-2", -1, 0, 7.5)]


def ids(objects):
    return [found.id for found in objects]


def test_a_polygon_with_a_notch():
    """An L whose upper arm narrows: the notch is outside, either way round."""
    corners = [(0, 0), (4, 0), (4, 2), (2, 2), (1, 4), (0, 4)]
    objects = [item("a-1", 1, 3), item("b-1", 3, 3), item("c-1", 3.9, 1), item("d-1", -0.01, 1), item("e-1", 1.7, 3)]
    assert ids(inside_polygon(objects, corners)) == ["a-1", "c-1"]
    assert ids(inside_polygon(objects, corners[::-1])) == ["a-1", "c-1"]


@pytest.mark.parametrize("corners", [[(0, 0), (1, 1)], [(0, 0, 0)] * 3, [(0, 0), (1, float("nan")), (2, 2)]])
def test_what_is_no_polygon_is_refused(corners):
    with pytest.raises(MapError, match="three corners"):
        inside_polygon(ROOM, corners)


HALL = Zone("zone-1", "hall", ((0.0, 0.0), (2.0, 0.0), (2.0, 2.0), (0.0, 2.0)))
(CHAIR,) = mapped([("chair", 1.0, 1.0)])
OUT = replace(CHAIR, position_m=np.array([3.0, 1.0]))


def told(watch, frames):
    """Kinds and stamps of the events of frames 0.1 s apart: what is on the map, and how many frames long."""
    events, stamp_s = [], 0.0
    for objects, count in frames:
        for _ in range(count):
            events += watch.update(objects, [HALL], stamp_s)
            stamp_s = round(stamp_s + 0.1, 6)
    return [(event.kind, event.item.id) for event in events], events


def test_what_is_there_at_first_is_no_event_and_what_moves_is():
    kinds, events = told(ZoneWatch(), [([CHAIR], 20), ([OUT], 20), ([CHAIR], 20), ([], 20)])
    assert kinds == [("left", "chair-1"), ("entered", "chair-1"), ("left", "chair-1")]
    assert 3.0 <= events[0].stamp_s <= 3.6  # settled for a second
    assert events[0].record() == {
        "event_type": "left", "zone": "zone-1", "zone_name": "hall", "id": "chair-1", "label": "chair", "x_m": 1.0,
        "y_m": 1.0,
    }  # fmt: skip


def test_a_centre_that_wavers_on_the_border_is_no_event():
    kinds, _ = told(ZoneWatch(), [([CHAIR], 20), *[([OUT], 6), ([CHAIR], 6)] * 8])
    assert kinds == []


def test_a_new_object_enters_and_a_new_zone_has_what_is_in_it():
    kinds, _ = told(ZoneWatch(), [([], 20), ([CHAIR], 20)])
    assert kinds == [("entered", "chair-1")]
    watch = ZoneWatch()
    assert watch.update([CHAIR], [], 0.0) == []
    assert watch.update([CHAIR], [HALL], 1.0) == []  # drawn around it
    larger = replace(HALL, corners_m=((0.0, 0.0), (4.0, 0.0), (4.0, 2.0), (0.0, 2.0)))
    assert watch.update([OUT], [larger], 2.0) == []
    assert watch.update([OUT], [], 3.0) == []


RULE = replace(FootprintRule(), margin_m=0.0)


def outlined(label: str, shape: ObjectFootprint | None, at: tuple[float, float] = (3.0, 1.0)) -> MapObject:
    covariance = np.eye(2) * 0.01
    return MapObject(f"{label}-1", label, np.array(at), covariance, 1.0, 0.8, 9, 0.9, 0.0, 1.0, measured=shape)


def outline(corners: np.ndarray, lens: np.ndarray) -> np.ndarray:
    """Lens and both ends of the lower edge of the box round a rectangle, for a level camera that faces its middle."""
    forward = corners.mean(axis=0) - lens
    forward /= np.linalg.norm(forward)
    left = np.array([-forward[1], forward[0]])
    along, across = (corners - lens) @ forward, (corners - lens) @ left
    near, slopes = along.min(), across / along
    return np.array([lens, *(lens + near * (forward + slope * left) for slope in (slopes.max(), slopes.min()))])


@pytest.mark.parametrize("yaw_deg", [0, 35, 90, 140])
@pytest.mark.parametrize(("label", "size"), [("couch", (1.7, 0.8)), ("bed", (1.4, 2.1)), ("dining table", (1.6, 0.8))])
def test_a_rectangle_seen_from_several_sides_is_found(label: str, size: tuple[float, float], yaw_deg: int):
    true = outlined(label, ObjectFootprint(size[0], size[1], math.radians(yaw_deg), 0.1))
    angles = np.radians(np.linspace(-90.0, 90.0, 7) + yaw_deg)
    views = true.position_m + 3.0 * np.column_stack([np.cos(angles), np.sin(angles)])
    outlines = np.array([outline(outline_m(true), lens) for lens in views])
    found = fitted(label, 1.0, true.position_m + [0.1, -0.1], outlines, None, RULE)
    assert found is not None
    assert found.shape.yaw_rad is not None
    assert (found.shape.width_m, found.shape.depth_m) == pytest.approx(size, abs=0.1)
    assert found.offset_m == pytest.approx([-0.1, 0.1], abs=0.07)
    assert abs(wrap_angle(found.shape.yaw_rad - math.radians(yaw_deg))) < math.radians(6.0)
    assert found.shape.yaw_sigma_rad < RULE.unknown_rad


def test_what_no_box_outlines_is_a_circle():
    assert fitted("chair", 0.5, np.zeros(2), np.zeros((0, 3, 2)), None, RULE) is None
    circle = outline_m(outlined("chair", None))
    assert np.ptp(np.linalg.norm(circle - [3.0, 1.0], axis=1)) < 1e-9


@pytest.mark.parametrize("shape", [None, ObjectFootprint(1.9, 0.8, 2.5, 0.2), ObjectFootprint(0.7, 0.7)])
def test_a_footprint_survives_the_file_and_a_person_overrides_it(shape):
    before = outlined("couch", shape)
    (after,), _ = read_map(saved_text(map_document([before])).encode(), "test")
    assert outline_m(after) == pytest.approx(outline_m(before), abs=1e-3)
    turned = replace(before, yaw_rad=1.0, depth_m=0.5, corrected=("yaw", "size"))
    (read,), _ = read_map(saved_text(map_document([turned])).encode(), "test")
    assert outline_m(read) == pytest.approx(outline_m(turned), abs=1e-3)
    assert np.linalg.norm(outline_m(read)[0] - outline_m(read)[3]) == pytest.approx(0.5, abs=1e-3)


def test_the_surer_yaw_of_two_maps_stays_and_a_robot_stops_at_the_front():
    shapes = ObjectFootprint(2.0, 0.9, 0.5, 0.1), ObjectFootprint(1.8, 0.9, 1.2, 0.4)
    sure, unsure = (outlined("couch", shape) for shape in shapes)
    assert fused(unsure, sure, LandmarkRule()).measured == sure.measured
    goal = approach(sure, [sure])
    assert math.atan2(goal.pose.y_m - 1.0, goal.pose.x_m - 3.0) == pytest.approx(0.5, abs=0.2)


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


def test_it_stands_before_the_object_on_its_front_and_faces_it():
    (chair,) = mapped([("chair", 2.0, 0.0)])
    found = approach(chair, [chair], floor(), (0.0, 0.0))
    assert found.floor == "free"
    assert found.standoff_m == pytest.approx(0.4)
    assert found.pose.x_m == pytest.approx(2.0 - radius_m(chair) - 0.4 - 0.25, abs=0.01)
    assert found.pose.vector()[1:] == pytest.approx([0.0, 0.0], abs=0.01)
    (couch,) = mapped([("couch", 0.0, 0.0)])
    couch = replace(couch, yaw_rad=math.pi / 2, depth_m=0.9, width_m=2.0)
    found = approach(couch, [couch], floor(), (-3.0, 0.0))
    assert found.pose.y_m == pytest.approx(0.45 + 0.4 + 0.25, abs=0.02)  # half its depth, standoff, robot
    assert abs(found.pose.x_m) < 0.2
    # A quarter turn costs a metre. Before the chair another one takes 0.53 m: 34 degrees aside, or 0.5 m farther.
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
