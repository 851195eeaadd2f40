"""The robot's way: never into anything, within the robot's limits, the same for the same seed; the truth of it."""

from types import SimpleNamespace

import numpy as np
import pytest

from edgemap.geometry.camera.mount import Mount
from edgemap.geometry.se2 import SE2
from edgemap.simulation.apartment.apartment import Apartment
from edgemap.simulation.apartment.furniture import Model
from edgemap.simulation.apartment.layout import Placed
from edgemap.simulation.camera.film import CameraSetup
from edgemap.simulation.robot import motion
from edgemap.simulation.robot.explore import drive
from edgemap.simulation.robot.imu import Wheels, wheel_odometry
from edgemap.simulation.robot.motion import SAMPLE_S, Limits, Sampled
from edgemap.simulation.robot.plan_grid import PlanGrid, VisibilityEstimate
from edgemap.simulation.truth import object_records

LIMITS = Limits(speed_m_s=0.6, yaw_rate_rad_s=1.1)
SECONDS = 90.0

# A home of two rooms and a doorway, for which no furniture library is needed.
# label, x, y, width, depth, height, yaw
PIECES = (
    ("couch", 2.0, 0.55, 2.0, 0.9, 0.8, np.pi / 2),
    ("chair", 0.6, 3.0, 0.8, 0.8, 0.9, 0.0),
    ("dining table", 4.2, 3.0, 1.4, 0.9, 0.75, 0.0),
    ("chair", 3.4, 3.0, 0.45, 0.45, 0.9, 0.0),
    ("chair", 5.0, 3.0, 0.45, 0.45, 0.9, np.pi),
    ("potted plant", 0.4, 4.5, 0.4, 0.4, 1.2, 0.0),
    ("refrigerator", 5.6, 4.5, 0.6, 0.6, 1.8, np.pi),
    ("bed", 8.2, 1.2, 1.6, 2.0, 0.6, np.pi),
    ("potted plant", 9.6, 4.5, 0.4, 0.4, 1.0, 0.0),
    ("", 9.5, 3.0, 0.6, 0.5, 2.0, np.pi),
)
WALLS = ((0, 0, 10, 0.1), (0, 0, 0.1, 5), (9.9, 0, 10, 5), (0, 4.9, 10, 5), (6, 0, 6.1, 2.3), (6, 3.3, 6.1, 5))


def piece(number, label, x, y, width, depth, height, yaw, z=0.0):
    model = SimpleNamespace(width_m=width, depth_m=depth, height_m=height)
    pose = SE2(x, y, yaw)
    at = {"pose_home_object": pose, "middle_home_m": pose.vector()[:2], "z_m": z, "on_floor": z < 0.02}
    return SimpleNamespace(id=number, label=label, model=model, **at)


def home(pieces=PIECES, walls=WALLS, width_m=10.0, depth_m=5.0):
    plan = SimpleNamespace(width_m=width_m, depth_m=depth_m, height_m=2.5, walls=walls, rooms=(None, None))
    return SimpleNamespace(plan=plan, furniture=tuple(piece(i, *row) for i, row in enumerate(pieces, start=1)))


def distance_to_footprint(item, points):
    """Distance (N,) from points to an oriented rectangle, by hand."""
    local = np.abs(item.pose_home_object.inverse().apply(points))
    beyond = np.maximum(local - [item.model.depth_m / 2, item.model.width_m / 2], 0.0)
    return np.linalg.norm(beyond, axis=1)


@pytest.fixture(scope="module")
def place():
    flat, camera = home(), CameraSetup()
    return flat, VisibilityEstimate(flat, PlanGrid(flat), camera.intrinsics, camera.mount)


@pytest.fixture(scope="module", params=[0, 1, 2])
def driven(request, place):
    return drive(place[1], LIMITS, np.random.default_rng(request.param), SECONDS)


def test_the_robot_never_touches_anything(driven, place):
    flat, _ = place
    points = driven.samples[:, :2]
    for item in flat.furniture:
        assert distance_to_footprint(item, points).min() > LIMITS.radius_m, item
    for x0, y0, x1, y1 in flat.plan.walls:
        beyond = np.maximum(np.maximum([x0, y0] - points, points - [x1, y1]), 0.0)
        assert np.linalg.norm(beyond, axis=1).min() > LIMITS.radius_m, (x0, y0)


def test_speeds_and_accelerations_keep_to_the_limits(driven):
    steps = np.diff(driven.samples, axis=0) / SAMPLE_S
    c, s = np.cos(driven.samples[:-1, 2]), np.sin(driven.samples[:-1, 2])
    forward, left = c * steps[:, 0] + s * steps[:, 1], c * steps[:, 1] - s * steps[:, 0]
    assert np.abs(left).max() < 0.035, "a differential drive does not move sideways"
    assert forward.max() < 1.02 * LIMITS.speed_m_s
    assert forward.min() > -0.55 * LIMITS.speed_m_s
    assert np.abs(steps[:, 2]).max() < 1.2 * LIMITS.yaw_rate_rad_s
    smooth = np.convolve(forward, np.ones(5) / 5, mode="valid")
    assert np.abs(np.diff(smooth)).max() / SAMPLE_S < 1.6 * LIMITS.acceleration_m_s2
    assert np.abs(driven.samples[1] - driven.samples[0]).max() < 0.01, "it starts from rest"


def test_it_gets_somewhere_through_the_door_and_sees_things(driven, place):
    _, sight = place
    poses = driven.at(np.arange(0.0, SECONDS, 0.1))
    assert np.linalg.norm(np.diff(poses[:, :2], axis=0), axis=1).sum() > 0.3 * SECONDS
    assert poses[:, 0].min() < 6.0 < poses[:, 0].max(), "both rooms"
    seen = sight.shares(poses) > 0.4
    assert (seen.sum(axis=0) >= 10).sum() >= 7
    assert (seen.sum(axis=1) == 0).mean() < 0.45, "it stares at walls"


def test_a_longer_drive_begins_as_the_shorter_one(place):
    _, sight = place
    short = drive(sight, LIMITS, np.random.default_rng(7), 20.0)
    long = drive(sight, LIMITS, np.random.default_rng(7), 60.0)
    assert np.array_equal(long.samples[: len(short.samples)], short.samples)


def test_a_wall_hides_and_a_table_hides_only_what_is_lower():
    """From 0.6 m up: a chair behind a wall is not seen; behind a table 0.5 m high its upper part is."""
    chair = ("chair", 4.0, 2.0, 0.5, 0.5, 1.0, np.pi)
    camera = CameraSetup(mount=Mount(0.6))
    shares = {}
    table, wall = ("dining table", 2.5, 2.0, 1.0, 0.6, 0.5, 0.0), (2.4, 1.0, 2.5, 3.0)
    for name, pieces, walls in (("free", (), ()), ("table", (table,), ()), ("wall", (), (wall,))):
        flat = home((chair, *pieces), walls, 6.0, 4.0)
        sight = VisibilityEstimate(flat, PlanGrid(flat), camera.intrinsics, camera.mount)
        shares[name] = sight.shares(np.array([[0.5, 2.0, 0.0]]))[0, 0]
        assert sight.shares(np.array([[0.5, 2.0, np.pi]]))[0, 0] == 0.0, "behind the camera"
    assert shares["free"] == 1.0
    assert 0.3 < shares["table"] < 0.9
    assert shares["wall"] == 0.0


def test_a_turn_and_a_straight_take_the_time_of_their_trapezium():
    """1.8 rad at 0.9 rad/s with 2 rad/s^2: 2 s and 0.45 s for getting up to speed and stopping."""
    limits = Limits(yaw_rate_rad_s=0.9, yaw_acceleration_rad_s2=2.0)
    pose = np.array([1.0, 2.0, 0.5])
    turned = motion.turn(pose, -1.8, limits)
    assert turned[-1] == pytest.approx([1.0, 2.0, 0.5 - 1.8])
    assert len(turned) * SAMPLE_S == pytest.approx(2.45, abs=0.6)
    back = motion.straight(pose, -0.4, limits)
    assert back[-1] == pytest.approx([1.0 - 0.4 * np.cos(0.5), 2.0 - 0.4 * np.sin(0.5), 0.5])


def test_perfect_wheels_tell_the_truth_to_a_tick():
    perfect = Wheels(tick_m=1e-6, scale=0.0, unlike=0.0, base_scale=0.0, creep=0.0, slips_per_m=0.0)
    turning = Sampled(np.stack([0.5 * np.sin(t := np.arange(500) * 0.01), 0.5 * (1 - np.cos(t)), t], axis=1))
    rows = wheel_odometry(turning, np.arange(95) / 10.0, np.random.default_rng(0), perfect)
    np.testing.assert_allclose(rows[:, 1:3], turning.at(rows[:, 0])[:, :2], atol=2e-4)
    assert abs(SE2(0, 0, rows[-1, 3] - turning.at(rows[-1:, 0])[0, 2]).yaw_rad) < 2e-4


MODEL = Model("Scopia", "thing", "somebody", "thing.obj", 0.6, 0.4, 0.9)


def placed(number, label, x_m=3.0, y_m=2.0, yaw_rad=0.0, z_m=0.0):
    return Placed(number, label, MODEL, SE2(x_m, y_m, yaw_rad), z_m)


def seen(number, visible=0.8, side_px=30):
    return {"id": number, "box": [10, 20, 10 + side_px, 30], "visible": visible}


def test_objects_are_told_in_the_frame_of_the_first_pose():
    """From (1, 2) looking along y, a chair at (0, 5) is 3 m ahead and 1 m to the left, turned back by a quarter."""
    (record,) = object_records(
        Apartment(None, (placed(7, "chair", 0.0, 5.0),)),
        SE2(1.0, 2.0, np.pi / 2),
        [[seen(7)], [seen(7, visible=0.2)], [seen(7, side_px=20)], [], [seen(7, visible=0.3, side_px=24)]],
    )
    assert (record["id"], record["label"], record["on_floor"]) == (7, "chair", True)
    assert (record["x_m"], record["y_m"]) == pytest.approx((3.0, 1.0))
    assert (record["width_m"], record["depth_m"], record["height_m"]) == (0.6, 0.4, 0.9)
    # 0.4 m deep along the home's x, which is the map's -y; 0.6 m wide along the home's y, the map's x.
    assert np.ptp(record["footprint_m"], axis=0) == pytest.approx([0.6, 0.4])
    assert record["visible_frames"] == 2


def test_people_and_pets_are_no_objects_of_the_map():
    labels = ("person", "chair", "cat", "dog", "", "tv")
    furniture = tuple(placed(number, label, z_m=0.5 * (label == "tv")) for number, label in enumerate(labels, 1))
    records = object_records(Apartment(None, furniture), SE2(0.0, 0.0, 0.0), [])
    assert [(record["label"], record["on_floor"]) for record in records] == [("chair", True), ("tv", False)]


def test_a_drive_is_not_chosen_for_the_people_and_pets_in_view():
    """What the contract counts comes from `VisibilityEstimate`: the cat on the carpet is none of it."""
    flat = home((*PIECES, ("cat", 3.0, 1.8, 0.2, 0.4, 0.3, 0.0), ("person", 1.2, 2.0, 0.5, 0.4, 1.7, 0.0)))
    camera = CameraSetup()
    sight = VisibilityEstimate(flat, PlanGrid(flat), camera.intrinsics, camera.mount)
    assert sight.ids.tolist() == list(range(1, 10))
