"""What the simulated camera adds to a picture: shutter, noise, exposure, shake; each against a number apart."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from edgemap.geometry.camera.intrinsics import Intrinsics
from edgemap.geometry.camera.mount import Mount
from edgemap.geometry.se2 import SE2
from edgemap.simulation.apartment.apartment import furnish
from edgemap.simulation.camera.exposure import LightScript, gains
from edgemap.simulation.camera.film import noisy
from edgemap.simulation.camera.shutter import exposed, flow_px_s, optical_twist
from edgemap.simulation.envelope import Envelope
from edgemap.simulation.render.scene import Probes
from edgemap.simulation.robot.motion import Sampled
from edgemap.simulation.robot.plan_grid import PlanGrid
from edgemap.simulation.views import draw_views

LENS = Intrinsics(160, 120, 150.0, 145.0, 81.0, 57.0)
MOUNT = Mount.from_degrees(0.5, 12.0, roll_deg=3.0, forward_m=0.2, left_m=-0.05)


def test_flow_is_how_points_move_when_the_robot_does():
    """Against the geometry itself: points at their depths, seen from poses 1 ms apart."""
    velocity, step_s = np.array([0.5, 0.0, -0.8]), 1e-3
    depth = np.random.default_rng(0).uniform(0.6, 5.0, (120, 160)).astype(np.float32)
    flow = flow_px_s(depth, LENS, *optical_twist(velocity, MOUNT))
    rotation, arm = MOUNT.rotation_base_optical(), MOUNT.position_base_m()
    for row, column in ((3, 5), (60, 80), (110, 150), (20, 140)):
        point = LENS.rays([[column, row]])[0] * depth[row, column]
        base = rotation @ point + arm
        ahead = SE2(velocity[0] * step_s, 0.0, velocity[2] * step_s)
        moved = np.append(ahead.inverse().apply(base[:2]), base[2])
        expected = (LENS.project((moved - arm) @ rotation)[0] - [column, row]) / step_s
        np.testing.assert_allclose(flow[row, column], expected, rtol=0.01, atol=0.3)


def edge():
    picture = np.zeros((120, 160, 3), np.uint8)
    picture[:, 80:] = 200
    return picture, np.full((120, 160), 3.0, np.float32)


def test_a_turn_smears_an_edge_over_focal_length_times_angle_and_a_camera_at_rest_none():
    """0.8 rad/s for 50 ms at 150 px focal length: 6 px from dark to bright."""
    picture, depth = edge()
    level = Mount(0.5)
    blurred = exposed(picture, depth, LENS, optical_twist(np.array([0.0, 0.0, 0.8]), level), 0.05, 0.0)
    smeared = (blurred[60, :, 0] > 2) & (blurred[60, :, 0] < 198)
    assert 4 <= smeared.sum() <= 8
    assert int(blurred[60, 80, 0]) == pytest.approx(100, abs=45)
    again = exposed(picture, depth, LENS, optical_twist(np.array([0.0, 0.0, 0.8]), level), 0.05, 0.0)
    assert np.array_equal(blurred, again)
    assert exposed(picture, depth, LENS, optical_twist(np.zeros(3), MOUNT), 0.05, 0.02) is picture


def test_a_rolling_shutter_leans_an_edge():
    """Turning left, the scene goes right: later rows have it further right, 150 px x 1 rad/s x 40 ms = 6 px in all."""
    picture, depth = edge()
    leaning = exposed(picture, depth, LENS, optical_twist(np.array([0.0, 0.0, 1.0]), Mount(0.5)), 0.0, 0.04)
    at = [int(np.argmax(leaning[row, :, 0] > 100)) for row in (2, 60, 117)]
    assert at[2] - at[0] == pytest.approx(6, abs=1)
    assert at[1] == pytest.approx(80, abs=1)


def test_noise_has_the_sensors_variance_and_repeats():
    """Mid grey, shot 0.05 and read 0.01 at gain 2: the variance in linear light, back through gamma's slope."""
    picture = np.full((200, 200, 3), 128, np.uint8)
    taken = noisy(picture, 0.05, 0.01, 2.0, np.random.default_rng(3))
    light = (128 / 255) ** 2.2
    slope = (128 / 255) ** (1.0 - 2.2) / 2.2
    expected = 255 * slope * math.sqrt(0.05**2 * 2.0 * light + 0.02**2)
    assert taken.std() == pytest.approx(expected, rel=0.05)
    assert taken.mean() == pytest.approx(128.0, abs=0.3)
    assert np.array_equal(taken, noisy(picture, 0.05, 0.01, 2.0, np.random.default_rng(3)))


def test_exposure_follows_a_switched_lamp_with_its_lag():
    """A room that is everywhere as bright as its shares say; 0.7 s after the switch, with a lag of 0.5 s."""
    probes = Probes(np.zeros(3), np.ones(3), np.full((1, 1, 1, 6, 6), 0.25, np.float32))
    script = LightScript(day=0.0, lamp=0.8, switches_s=(10.0,), switched=0.1)
    stands = Sampled(np.zeros((2, 3)))
    before, after, settled = gains(probes, script, stands, np.array([9.5, 10.2 + 0.5, 20.0]), 0.5)
    assert before < after < settled
    share = math.log(after / before) / math.log(settled / before)
    assert share == pytest.approx(1.0 - math.exp(-0.7 / 0.5), abs=0.08)
    longer = gains(probes, script, stands, np.array([9.5, 10.7, 20.0, 60.0]), 0.5)
    np.testing.assert_allclose(longer[:3], [before, after, settled])


@settings(max_examples=60)
@given(st.integers(0, 10**6))
def test_draws_stay_in_the_envelope(seed):
    rng, envelope = np.random.default_rng(seed), Envelope()
    camera = envelope.draw_camera(rng)
    assert 0.15 <= camera.mount.height_m <= 1.3
    assert -5.0 <= math.degrees(camera.mount.pitch_rad) <= 30.0
    lens = camera.intrinsics
    assert 55.0 <= 2 * math.degrees(math.atan(320 / lens.fx)) <= 90.0
    corners = np.array([[0, 0], [639, 0], [0, 479], [639, 479]], dtype=float)
    np.testing.assert_allclose(lens.project(lens.rays(corners)), corners, atol=0.01)
    light = envelope.draw_light(rng)
    day, lamp = light.at(np.arange(0.0, 300.0, 0.5))
    assert (day >= 0).all()
    assert (day <= 1).all()
    assert (lamp >= 0).all()
    assert (lamp <= 1).all()
    assert 0.0 < envelope.draw_effects(rng, light).exposure_s <= 0.033


def ahead_m(grid, view):
    """How far the floor is free straight ahead."""
    pose, steps = view.pose_home_base, np.arange(0.0, 12.0, 0.02)
    points = np.array([pose.x_m, pose.y_m]) + steps[:, None] * [np.cos(pose.yaw_rad), np.sin(pose.yaw_rad)]
    return steps[np.argmax(grid.tops_m[grid.cells_of(points)] > 0.0)]


def test_close_views_have_less_floor_ahead_and_leave_the_others_alone():
    home = furnish(3)
    usual, mixed = draw_views(home, 3, 8), draw_views(home, 3, 8, close=0.5)
    grid = PlanGrid(home)
    assert [view.pose_home_base for view in mixed[:4]] == [view.pose_home_base for view in usual[:4]]
    assert [view.camera for view in mixed] == [view.camera for view in usual]
    near, far = ([ahead_m(grid, view) for view in views[4:]] for views in (mixed, usual))
    assert np.median(near) < 0.5 * np.median(far)


def test_carried_cameras_are_higher_than_a_robots():
    robots, carried = ([view.camera.mount for view in draw_views(furnish(3), 3, 8, carried=by)] for by in (False, True))
    assert max(mount.height_m for mount in robots) <= 1.3
    assert all(1.2 <= mount.height_m <= 1.75 and mount.pitch_rad > 0.0 for mount in carried)
