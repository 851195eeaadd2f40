import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from edgemap.geometry.camera.floor import FloorCamera
from edgemap.geometry.camera.intrinsics import Intrinsics
from edgemap.geometry.camera.mount import Mount
from edgemap.geometry.paper import equations as paper
from edgemap.geometry.se2 import SE2

CAMERA = Intrinsics(640, 480, 500.0, 500.0, 320.0, 240.0)


def test_equation_3_by_hand():
    """Level camera 1 m up, edge 100 px below the centre of a 500 px lens: Z = 1 / (100 / 500) = 5 m."""
    theta_o = paper.projection_angle_rad(340.0, 240.0, 500.0)
    assert paper.floor_distance_m(1.0, 0.0, theta_o) == pytest.approx(5.0)


def test_equation_3_at_and_above_the_horizon_is_infinite():
    assert paper.floor_distance_m(1.0, 0.2, 0.2) == math.inf
    assert paper.floor_distance_m(1.0, 0.2, 0.3) == math.inf


@given(st.floats(0.2, 1.8), st.floats(-5, 40), st.floats(0.4, 12))
def test_equation_3_is_ray_floor_intersection_at_any_pitch(height_m, pitch_deg, forward_m):
    camera = FloorCamera(CAMERA, Mount.from_degrees(height_m, pitch_deg))
    pixel = camera.project([[forward_m, 0.0]])[0]
    if not np.isfinite(pixel).all() or not camera.below_horizon([pixel])[0]:
        return
    theta_h = paper.projection_angle_rad(camera.horizon_row(), CAMERA.cy, CAMERA.fy)
    theta_o = paper.projection_angle_rad(pixel[1], CAMERA.cy, CAMERA.fy)
    assert paper.floor_distance_m(height_m, theta_h, theta_o) == pytest.approx(forward_m, rel=1e-6)


@given(st.floats(0.2, 1.8), st.floats(-5, 40), st.floats(0.6, 8), st.floats(-3, 3))
def test_equation_4_is_exact_with_optical_depth_and_positive_left(height_m, pitch_deg, forward_m, left_m):
    camera = FloorCamera(CAMERA, Mount.from_degrees(height_m, pitch_deg))
    point = np.array([[forward_m, left_m]])
    pixel = camera.project(point)[0]
    if not np.isfinite(pixel).all():
        return
    depth = float(camera.optical_depth_m(point)[0])
    assert paper.lateral_offset_m(depth, pixel[0], CAMERA.cx, CAMERA.fx) == pytest.approx(left_m, abs=1e-6)


def test_optical_depth_is_the_forward_distance_only_at_zero_pitch():
    point = np.array([[3.0, 0.5]])
    assert FloorCamera(CAMERA, Mount(0.8)).optical_depth_m(point)[0] == pytest.approx(3.0)
    pitched = FloorCamera(CAMERA, Mount.from_degrees(0.8, 20.0)).optical_depth_m(point)[0]
    assert pitched == pytest.approx(3.0 * math.cos(math.radians(20)) + 0.8 * math.sin(math.radians(20)))


def test_size_by_hand():
    assert paper.size_m(4.0, 125.0, 500.0) == pytest.approx(1.0)


def test_equations_5_and_6_hold_the_inverse_of_the_robots_motion():
    """The robot drives 1 m towards a chair 3 m ahead: the chair is then 2 m ahead."""
    assert paper.move_points([[3.0, 0.0]], SE2(1.0, 0.0, 0.0))[0] == pytest.approx([2.0, 0.0])
    """It turns left by 90 degrees: the chair is then on its right."""
    assert paper.move_points([[3.0, 0.0]], SE2(0.0, 0.0, math.pi / 2))[0] == pytest.approx([0.0, -3.0])


@given(st.floats(-2, 2), st.floats(-2, 2), st.floats(-3, 3), st.floats(-5, 5), st.floats(-5, 5))
def test_equation_5_keeps_a_standing_object_in_its_place(dx, dy, turn, x, y):
    motion = SE2(dx, dy, turn)
    moved = paper.move_points([[x, y]], motion)
    np.testing.assert_allclose(motion.apply(moved), [[x, y]], atol=1e-9)


def test_equation_8_has_its_root():
    assert paper.distance_m([0, 0], [3, 4]) == pytest.approx(5.0)


def test_equation_9_by_hand():
    assert paper.paper_rmse([[0, 0], [0, 0]], [[3, 4], [0, 0]]) == pytest.approx(math.sqrt(12.5))


def test_paper_axes():
    np.testing.assert_allclose(paper.xz_of([[2.0, 1.0]]), [[-1.0, 2.0]])


def test_equation_6_holds_the_inverse_motion_in_the_plane_and_leaves_heights_alone():
    """After 1 m forwards and a left turn, what was 1 m ahead is here; a height stays what it is."""
    change = paper.map_change(SE2(1.0, 0.0, math.pi / 2.0))
    np.testing.assert_allclose(
        change, [[0.0, 1.0, 0.0, 0.0], [-1.0, 0.0, 0.0, 1.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]], atol=1e-12
    )
