"""geometry's distortion models against librealsense's own projection, an independent implementation."""

from typing import Any

import numpy as np
import pytest

from edgemap.geometry.camera.intrinsics import Distortion, Intrinsics

rs: Any = pytest.importorskip("pyrealsense2")

COEFFICIENTS = (-0.055, 0.064, 0.0009, -0.0006, -0.021)
PIXELS = [(u, v) for u in range(20, 640, 75) for v in range(20, 480, 55)]


def both(model, coefficients):
    theirs = rs.intrinsics()
    theirs.width, theirs.height = 640, 480
    theirs.fx, theirs.fy, theirs.ppx, theirs.ppy = 615.2, 615.4, 321.1, 239.7
    theirs.model, theirs.coeffs = getattr(rs.distortion, model), list(coefficients)
    return theirs, Intrinsics(640, 480, 615.2, 615.4, 321.1, 239.7, Distortion(model, coefficients))


# librealsense does not deproject modified_brown_conrady: the round trip below covers that one.
@pytest.mark.parametrize("model", ["brown_conrady", "inverse_brown_conrady"])
def test_rays_agree_with_librealsense(model):
    theirs, ours = both(model, COEFFICIENTS)
    expected = np.array([rs.rs2_deproject_pixel_to_point(theirs, list(map(float, pixel)), 1.0) for pixel in PIXELS])
    np.testing.assert_allclose(ours.rays(PIXELS), expected, atol=2e-5)


@pytest.mark.parametrize("model", ["brown_conrady", "inverse_brown_conrady", "modified_brown_conrady"])
def test_projection_agrees_with_librealsense(model):
    theirs, ours = both(model, COEFFICIENTS)
    rays = np.array([[(u - 321.1) / 615.2, (v - 239.7) / 615.4, 1.0] for u, v in PIXELS])
    expected = np.array([rs.rs2_project_point_to_pixel(theirs, ray.tolist()) for ray in rays])
    np.testing.assert_allclose(ours.project(rays), expected, atol=0.02)


@pytest.mark.parametrize("model", ["brown_conrady", "inverse_brown_conrady", "modified_brown_conrady"])
def test_rays_invert_librealsense_projection(model):
    theirs, ours = both(model, COEFFICIENTS)
    rays = np.array([[(u - 321.1) / 615.2, (v - 239.7) / 615.4, 1.0] for u, v in PIXELS])
    pixels = [rs.rs2_project_point_to_pixel(theirs, ray.tolist()) for ray in rays]
    np.testing.assert_allclose(ours.rays(pixels), rays, atol=1e-6)
