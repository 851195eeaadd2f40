"""The way through the room, the wheels, and the truth of the boxes."""

from itertools import pairwise

import numpy as np
import pytest

from edgemap.geometry.se2 import SE2
from edgemap.simulation.robot.drive import FreeSpace, Limits, drive_along, wheel_odometry


def distance_to_footprint(item, points):
    """Distance (N,) from points to an oriented rectangle, by hand."""
    local = np.abs(item.pose_home_object.inverse().apply(points))
    beyond = np.maximum(local - [item.model.depth_m / 2, item.model.width_m / 2], 0.0)
    return np.linalg.norm(beyond, axis=1)


@pytest.fixture(scope="module")
def drive(furniture_catalogue):
    from edgemap.simulation.apartment.apartment import furnish
    from edgemap.simulation.world import CameraSetup, plan_drive

    apartment = furnish(5)
    return apartment, plan_drive(apartment, CameraSetup(), 120, 5)


def test_drive_never_touches_anything(drive):
    apartment, poses = drive
    points = np.array([[pose.x_m, pose.y_m] for pose in poses])
    radius = Limits().radius_m
    assert points.min() > radius
    assert (points < [apartment.shell.width_m - radius, apartment.shell.depth_m - radius]).all()
    for item in apartment.furniture:
        if item.on_floor:
            assert distance_to_footprint(item, points).min() > radius, item


def test_drive_is_smooth_and_starts_and_ends_at_rest(drive):
    _, poses = drive
    limits = Limits()
    motions = np.array([(a.inverse() @ b).vector() for a, b in pairwise(poses)]) * 10.0
    assert np.abs(motions[:, 1]).max() < 0.05, "a differential drive does not move sideways"
    assert motions[:, 0].max() < limits.speed_m_s * 1.02
    assert motions[:, 0].min() >= 0.0
    assert np.abs(motions[:, 2]).max() < limits.yaw_rate_rad_s * 1.6
    assert np.abs(np.diff(motions[:, 0])).max() * 10.0 < limits.acceleration_m_s2 * 1.5
    assert motions[[0, -1], 0].max() < 0.15


def test_drive_of_a_seed_is_always_the_same(drive):
    from edgemap.simulation.world import CameraSetup, plan_drive

    apartment, poses = drive
    assert plan_drive(apartment, CameraSetup(), 120, 5) == poses


def test_straight_way_takes_the_time_of_its_trapezium():
    """2 m at 0.4 m/s with 0.4 m/s^2: about 5 s + 1 s for getting up to speed and stopping."""
    way = np.stack([np.linspace(0.0, 2.0, 201), np.zeros(201)], axis=1)
    limits = Limits(speed_m_s=0.4, acceleration_m_s2=0.4)
    assert drive_along(way, limits, 90, 10.0) is None
    poses = drive_along(way, limits, 62, 10.0)
    assert poses is not None
    assert poses[-1].x_m == pytest.approx(2.0)
    assert poses[31].x_m == pytest.approx(1.0, abs=0.08)


def test_free_space_measures_distance_to_walls_and_furniture(drive):
    apartment, _ = drive
    free = FreeSpace(apartment)
    rng = np.random.default_rng(0)
    points = rng.uniform([0.1, 0.1], [apartment.shell.width_m - 0.1, apartment.shell.depth_m - 0.1], (400, 2))
    walls = np.minimum(points, [apartment.shell.width_m, apartment.shell.depth_m] - points).min(axis=1)
    pieces = [distance_to_footprint(item, points) for item in apartment.furniture if item.on_floor]
    expected = np.minimum(walls, np.min(pieces, axis=0))
    assert np.abs(free.clearance_m(points) - expected).max() < 0.05


def test_wheels_drift_a_little_but_not_much():
    poses = [SE2(0.04 * i, 0.0, 0.0) for i in range(200)]
    ends = [wheel_odometry(poses, np.random.default_rng(seed))[-1] for seed in range(40)]
    errors = np.array([[end.x_m - poses[-1].x_m, end.y_m] for end in ends])
    assert 0.03 < np.abs(errors[:, 0]).mean() < 0.5
    assert 0.05 < np.abs(errors[:, 1]).mean() < 1.0


def test_boxes_hold_their_pixels(world, renderer):
    from edgemap.simulation.render.view import View
    from edgemap.simulation.truth import picture_boxes
    from edgemap.simulation.world import CameraSetup

    apartment, _ = world
    view = View.of_base(SE2(apartment.shell.width_m / 2, apartment.shell.depth_m / 2, -0.5), CameraSetup().mount)
    ids, _ = renderer.ids_and_depth(view)
    records = picture_boxes(renderer, view, apartment)
    assert records
    for record in records:
        rows, columns = np.nonzero(ids == record["id"])
        assert record["box"] == [columns.min(), rows.min(), columns.max() + 1, rows.max() + 1]
        assert 0.0 < record["visible"] <= 1.0


def test_visible_share_falls_when_the_border_cuts(world, renderer):
    """Turning away from the refrigerator lowers its visible share from nearly all to little."""
    from edgemap.simulation.render.view import View
    from edgemap.simulation.truth import picture_boxes
    from edgemap.simulation.world import CameraSetup

    apartment, _ = world
    setup = CameraSetup()
    chair = next(item for item in apartment.furniture if item.label == "couch")
    spot = chair.pose_home_object @ SE2(2.6, 0.0, np.pi)
    shares = []
    for turn in (0.0, 0.35, 0.55):
        records = picture_boxes(renderer, View.of_base(spot @ SE2(0.0, 0.0, turn), setup.mount), apartment)
        shares.append({record["id"]: record["visible"] for record in records}.get(chair.id, 0.0))
    assert shares[0] > 0.8
    assert shares[0] > shares[1] > shares[2]
