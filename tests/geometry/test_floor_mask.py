"""Floor masks and depth pictures between their cells, and the paper's equations of where a pixel meets the floor."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from edgemap.geometry.camera.depth_camera import DepthCamera
from edgemap.geometry.camera.depth_points import patch_depths
from edgemap.geometry.camera.floor import FloorCamera
from edgemap.geometry.camera.intrinsics import Distortion, Intrinsics
from edgemap.geometry.camera.mount import Mount
from edgemap.geometry.observations.floor_mask import FloorMask

HALF = np.array([[0.0, 0.0], [1.0, 1.0]], dtype=np.float32)  # floor below


def test_cells_have_their_own_value_and_outside_there_is_no_floor():
    mask = FloorMask(HALF, width=8, height=4)
    # Cell (0, c) covers rows 0 and 1, so its middle is the edge between them, 0.5 in pixel centres.
    np.testing.assert_allclose(mask.at([[3.0, 0.5], [3.0, 2.5], [3.0, 1.5], [3.0, 1.0]]), [0.0, 1.0, 0.5, 0.25])
    mask = FloorMask(np.ones((2, 2), np.float32), width=8, height=4)
    points = [[-0.6, 1.0], [7.6, 1.0], [1.0, 3.6], [np.nan, 1.0], [np.inf, 1.0], [-0.5, -0.5], [7.5, 3.5]]
    np.testing.assert_array_equal(mask.at(points), [0, 0, 0, 0, 0, 1, 1])
    assert mask.at(np.zeros((0, 2))).shape == (0,)
    with pytest.raises(ValueError, match="walls"):
        FloorMask(HALF, 8, 4, wall=np.zeros((3, 2), np.float32))
    with pytest.raises(ValueError, match="0x4"):
        FloorMask(HALF, 0, 4)


@given(
    st.integers(1, 9), st.integers(1, 9), st.integers(1, 700), st.integers(1, 700),
    st.floats(0, 1), st.floats(0, 1), st.integers(0, 99),
)  # fmt: skip
def test_any_point_has_a_value_between_those_of_cells(rows, columns, width, height, x, y, seed):
    floor = np.random.default_rng(seed).random((rows, columns), dtype=np.float32)
    (value,) = FloorMask(floor, width, height).at([[x * width - 0.5, y * height - 0.5]])
    assert floor.min() - 1e-6 <= value <= floor.max() + 1e-6
    right, down = min(int(x * columns), columns - 1), min(int(y * rows), rows - 1)
    around = floor[max(down - 1, 0) : down + 2, max(right - 1, 0) : right + 2]
    assert around.min() - 1e-6 <= value <= around.max() + 1e-6


def test_what_hides_a_foot_ends_where_floor_begins_in_most_columns():
    floor = np.zeros((8, 6), dtype=np.float32)
    floor[5:, 1:4], floor[7:, 4] = 1.0, 1.0
    mask = FloorMask(floor, width=60, height=80)
    assert mask.hidden_until((10, 0, 49, 25)) == 50.0  # rows 50, 50, 50 and 70
    assert mask.hidden_until((10, 0, 49, 45)) is None  # floor at the edge
    assert mask.hidden_until((50, 0, 59, 45)) == 80.0  # none down to the border
    assert mask.hidden_until((10, 0, 49, 75)) is None  # nothing is known below


CAMERA = Intrinsics(640, 480, 500.0, 500.0, 320.0, 240.0)


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


TURN = Rotation.from_euler("yx", [2.0, -1.5], degrees=True).as_matrix()
BESIDE = DepthCamera(Intrinsics(80, 60, 73.0, 73.0, 40.0, 30.0), TURN, np.array([-0.05, 0.01, 0.02]))
NORMAL, AWAY_M = np.array([0.2, -0.3, 0.93]), 2.0  # of a plane, in the picture's optical frame


def pixels_of(lens):
    v, u = np.mgrid[0 : lens.height, 0 : lens.width]
    return np.column_stack([u.ravel(), v.ravel()]).astype(np.float64)


def plane_by_the_depth_camera(camera):
    """The plane's depth, (H, W), along the depth camera's own axis."""
    rays = camera.intrinsics.rays(pixels_of(camera.intrinsics))
    depth = (AWAY_M - camera.position_m @ NORMAL) / (rays @ camera.rotation.T @ NORMAL)
    return depth.reshape(camera.intrinsics.height, camera.intrinsics.width).astype(np.float32)


@pytest.mark.parametrize(
    "lens",
    [
        Intrinsics(80, 60, 66.0, 66.0, 40.0, 30.0),
        Intrinsics(200, 150, 170.0, 172.0, 99.0, 75.0),
        Intrinsics(80, 60, 66.0, 66.0, 40.0, 30.0, Distortion("brown_conrady", (-0.1, 0.02, 0.0, 0.0, 0.0))),
    ],
    ids=["wider", "finer", "distorted"],
)
def test_a_plane_has_the_depth_that_the_picture_sees(lens):
    registered = BESIDE.registered(plane_by_the_depth_camera(BESIDE), lens)
    assert registered.shape == (lens.height, lens.width)
    expected = (AWAY_M / (lens.rays(pixels_of(lens)) @ NORMAL)).reshape(lens.height, lens.width)
    middle = (slice(lens.height // 4, -lens.height // 4), slice(lens.width // 4, -lens.width // 4))
    known = registered[middle] > 0.0
    assert known.mean() > 0.97
    assert np.abs(registered[middle] / expected[middle] - 1.0)[known].max() < 0.02  # a pixel of the depth picture


def test_the_nearer_of_two_hides_the_other_and_holes_stay_holes():
    """A board at 1 m before a wall at 3 m, seen from 0.3 m to its left: what it hides there is unknown."""
    lens = Intrinsics(80, 60, 73.0, 73.0, 40.0, 30.0)
    depth = np.full((60, 80), 3.0, dtype=np.float32)
    depth[:, 40:] = 1.0
    depth[:5] = 0.0
    registered = DepthCamera(lens, position_m=np.array([0.3, 0.0, 0.0])).registered(depth, lens)
    shift = {1.0: 22, 3.0: 7}  # px, 73 * 0.3 m / depth
    np.testing.assert_array_equal(registered[10, 40 + shift[1.0] :], 1.0)
    np.testing.assert_array_equal(registered[10, shift[3.0] + 1 : 40 + shift[3.0]], 3.0)
    np.testing.assert_array_equal(registered[10, 41 + shift[3.0] : 39 + shift[1.0]], 0.0)
    np.testing.assert_array_equal(registered[:5], 0.0)


def test_depth_of_a_patch_by_hand():
    depth = np.zeros((20, 20), np.float32)
    depth[:, :10], depth[:, 10:] = 2.0, 4.0
    depth[8:10, 2:4] = 2.1
    depth[:7] = np.nan
    points = np.array([[4.0, 11.0], [11.0, 12.0], [16.0, 12.0], [16.0, 7.0], [16.0, 6.0]])
    np.testing.assert_allclose(patch_depths(depth, points), [2.0, 4.0, 4.0, 4.0, np.nan])  # 21 of 49 valid
