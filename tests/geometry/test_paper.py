"""The paper's equations 3 and 4, written here as they stand there, against the camera's general forms."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from edgemap.geometry.camera.floor import FloorCamera
from edgemap.geometry.camera.intrinsics import Intrinsics
from edgemap.geometry.camera.mount import Mount

CAMERA = Intrinsics(640, 480, 500.0, 500.0, 320.0, 240.0)


def test_equation_3_by_hand():
    """Level camera 1 m up, edge 100 px below the centre of a 500 px lens: Z = 1 / (100 / 500) = 5 m."""
    camera = FloorCamera(CAMERA, Mount(1.0))
    assert camera.project([[5.0, 0.0]])[0] == pytest.approx([320.0, 340.0])


@given(st.floats(0.2, 1.8), st.floats(-5, 40), st.floats(0.4, 12))
def test_equation_3_is_ray_floor_intersection_at_any_pitch(height_m, pitch_deg, forward_m):
    """Z = h / tan(theta_h - theta_o), angles from the optical axis up to the horizon and to the box's lower edge."""
    camera = FloorCamera(CAMERA, Mount.from_degrees(height_m, pitch_deg))
    pixel = camera.project([[forward_m, 0.0]])[0]
    if not np.isfinite(pixel).all() or not camera.below_horizon([pixel])[0]:
        return
    theta_h, theta_o = (math.atan2(CAMERA.cy - row, CAMERA.fy) for row in (camera.horizon_row(), pixel[1]))
    assert height_m / math.tan(theta_h - theta_o) == pytest.approx(forward_m, rel=1e-6)


@given(st.floats(0.2, 1.8), st.floats(-5, 40), st.floats(0.6, 8), st.floats(-3, 3))
def test_equation_4_is_exact_with_optical_depth_and_positive_left(height_m, pitch_deg, forward_m, left_m):
    """left = depth * (x0 - xi) / f."""
    camera = FloorCamera(CAMERA, Mount.from_degrees(height_m, pitch_deg))
    point = np.array([[forward_m, left_m]])
    pixel = camera.project(point)[0]
    if not np.isfinite(pixel).all():
        return
    depth = float(camera.optical_depth_m(point)[0])
    assert depth * (CAMERA.cx - pixel[0]) / CAMERA.fx == pytest.approx(left_m, abs=1e-6)


def test_optical_depth_is_the_forward_distance_only_at_zero_pitch():
    point = np.array([[3.0, 0.5]])
    assert FloorCamera(CAMERA, Mount(0.8)).optical_depth_m(point)[0] == pytest.approx(3.0)
    pitched = FloorCamera(CAMERA, Mount.from_degrees(0.8, 20.0)).optical_depth_m(point)[0]
    assert pitched == pytest.approx(3.0 * math.cos(math.radians(20)) + 0.8 * math.sin(math.radians(20)))
