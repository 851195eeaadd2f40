"""Depth of another camera in the picture's pixels, against planes whose depth is computed for either."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from edgemap.geometry.camera.depth_camera import DepthCamera, DepthRegistration
from edgemap.geometry.camera.depth_points import patch_depths
from edgemap.geometry.camera.intrinsics import Distortion, Intrinsics

BESIDE = DepthCamera(
    Intrinsics(80, 60, 73.0, 73.0, 40.0, 30.0),
    Rotation.from_euler("yx", [2.0, -1.5], degrees=True).as_matrix(),
    np.array([-0.05, 0.01, 0.02]),
)
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
    registered = DepthRegistration(BESIDE, lens).registered(plane_by_the_depth_camera(BESIDE))
    assert registered is not None
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
    registered = DepthRegistration(DepthCamera(lens, position_m=np.array([0.3, 0.0, 0.0])), lens).registered(depth)
    assert registered is not None
    shift = {1.0: 22, 3.0: 7}  # px, 73 * 0.3 m / depth
    np.testing.assert_array_equal(registered[10, 40 + shift[1.0] :], 1.0)
    np.testing.assert_array_equal(registered[10, shift[3.0] + 1 : 40 + shift[3.0]], 3.0)
    np.testing.assert_array_equal(registered[10, 41 + shift[3.0] : 39 + shift[1.0]], 0.0)
    np.testing.assert_array_equal(registered[:5], 0.0)


def test_a_depth_picture_of_another_size_is_none():
    assert DepthRegistration(BESIDE, BESIDE.intrinsics).registered(np.ones((30, 40), np.float32)) is None


def test_depth_of_a_patch_by_hand():
    depth = np.zeros((20, 20), np.float32)
    depth[:, :10], depth[:, 10:] = 2.0, 4.0
    depth[8:10, 2:4] = 2.1
    depth[:7] = np.nan
    points = np.array([[4.0, 11.0], [11.0, 12.0], [16.0, 12.0], [16.0, 7.0], [16.0, 6.0]])
    np.testing.assert_allclose(patch_depths(depth, points), [2.0, 4.0, 4.0, 4.0, np.nan])  # 21 of 49 valid
