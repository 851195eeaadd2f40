"""Lens models of other programs against their own functions, OpenCV's and librealsense's; sizes and quarter turns."""

from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from edgemap.geometry.camera.intrinsics import Distortion, Intrinsics
from edgemap.geometry.errors import GeometryError

MATRIX = np.array([[300.0, 0.0, 310.0], [0.0, 305.0, 235.0], [0.0, 0.0, 1.0]])
RATIONAL = (0.3, 0.02, 1e-3, -2e-3, 0.001, 0.6, 0.05, 0.002)
FISHEYE = (-0.02, 0.01, -0.004, 0.0006)
POINTS = np.random.default_rng(1).uniform([20, 20], [620, 460], (200, 2))


def lens(distortion):
    return Intrinsics(640, 480, 300.0, 305.0, 310.0, 235.0, distortion)


def test_rational_and_fisheye_are_those_of_opencv():
    rational = lens(Distortion.named("rational_polynomial", RATIONAL))
    rays, zero = rational.rays(POINTS), np.zeros(3)
    np.testing.assert_allclose(
        cv2.projectPoints(rays, zero, zero, MATRIX, np.array(RATIONAL))[0][:, 0], POINTS, atol=1e-6
    )
    fisheye = lens(Distortion.named("equidistant", FISHEYE))
    expected = cv2.fisheye.undistortPoints(POINTS[:, None], MATRIX, np.array(FISHEYE))[:, 0]
    np.testing.assert_allclose(fisheye.rays(POINTS)[:, :2], expected, atol=1e-6)
    for model in (rational, fisheye):
        np.testing.assert_allclose(model.project(model.rays(POINTS)), POINTS, atol=1e-6)


@pytest.mark.parametrize(("name", "values", "model"), [
    ("plumb_bob", (0.0,) * 5, "none"), ("radtan", (0.1, 0.0, 0.0, 0.0), "brown_conrady"),
    ("rational_polynomial", (0.1, 0, 0, 0, 0, 0, 0, 0), "brown_conrady"), ("rational_polynomial", RATIONAL, "rational"),
    ("Kannala-Brandt", (0.0,) * 4, "equidistant"), ("equidistant", (), "equidistant"), ("", (), "none"),
])  # fmt: skip
def test_names_of_other_programs(name, values, model):
    assert Distortion.named(name, values).model == model


@pytest.mark.parametrize(("name", "values"), [
    ("double_sphere", (0.0, 0.0)), ("", (0.1,)), ("rational_polynomial", (*RATIONAL, 0.1, 0.0, 0.0, 0.0)),
    ("fov", (0.0,)), ("equidistant", (*FISHEYE, 0.1)), ("thin_prism_fisheye", ()),
])  # fmt: skip
def test_other_models_are_refused_by_name(name, values):
    with pytest.raises(GeometryError, match=f"'{name}'"):
        Distortion.named(name, values)


def test_another_size_of_the_same_shape_is_scaled_and_of_another_shape_refused():
    assert lens(Distortion()).fitted(320, 240).fx == 150.0
    with pytest.raises(GeometryError, match="for 640x480 px, the pictures 640x360 px"):
        lens(Distortion()).fitted(640, 360)


@given(degrees=st.sampled_from([90, 180, 270]), point=st.tuples(st.floats(-0.4, 0.4), st.floats(-0.4, 0.4)))
@pytest.mark.parametrize("distortion", [Distortion("brown_conrady", (0.1, -0.05, 2e-3, -1e-3, 0.01)),
    Distortion.named("equidistant", FISHEYE), Distortion("rational", RATIONAL), Distortion()])  # fmt: skip
def test_a_lens_turns_with_its_pictures(distortion, degrees, point):
    """A point of the picture as np.rot90 moves it is a ray about the optical axis as far round."""
    before = lens(distortion)
    after = before.rotated(degrees)
    (u, v), high, wide = before.project([[*point, 1.0]])[0], 480, 640
    for _ in range(degrees // 90):
        u, v, high, wide = high - 1 - v, u, wide, high
    x, y = point
    turned = {90: (-y, x), 180: (-x, -y), 270: (y, -x)}[degrees]
    assert (after.width, after.height) == (wide, high)
    np.testing.assert_allclose(after.project([[*turned, 1.0]])[0], (u, v), atol=1e-6)


rs: Any = pytest.importorskip("pyrealsense2")

COEFFICIENTS = (-0.055, 0.064, 0.0009, -0.0006, -0.021)
PIXELS = [(u, v) for u in range(20, 640, 75) for v in range(20, 480, 55)]


@pytest.mark.parametrize("model", ["brown_conrady", "inverse_brown_conrady", "modified_brown_conrady"])
def test_projection_agrees_with_librealsense(model):
    """That rays are its inverse, tests of the camera show."""
    theirs = rs.intrinsics()
    theirs.width, theirs.height = 640, 480
    theirs.fx, theirs.fy, theirs.ppx, theirs.ppy = 615.2, 615.4, 321.1, 239.7
    theirs.model, theirs.coeffs = getattr(rs.distortion, model), list(COEFFICIENTS)
    ours = Intrinsics(640, 480, 615.2, 615.4, 321.1, 239.7, Distortion(model, COEFFICIENTS))
    rays = np.array([[(u - 321.1) / 615.2, (v - 239.7) / 615.4, 1.0] for u, v in PIXELS])
    expected = np.array([rs.rs2_project_point_to_pixel(theirs, ray.tolist()) for ray in rays])
    np.testing.assert_allclose(ours.project(rays), expected, atol=0.02)
