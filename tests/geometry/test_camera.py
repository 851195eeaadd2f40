"""Lenses and mounts against OpenCV's and librealsense's functions, names of other programs, sizes, quarter turns."""

import math
from dataclasses import replace

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from edgemap.geometry.camera.floor import FloorCamera, FloorNoise, floor_covariances
from edgemap.geometry.camera.intrinsics import Distortion, Intrinsics
from edgemap.geometry.camera.mount import Mount
from edgemap.geometry.errors import GeometryError

PLAIN = Intrinsics(640, 480, 587.0, 585.0, 319.5, 239.5)
LENS = (-0.28, 0.09, 0.0012, -0.0008, -0.011)
BENT = replace(PLAIN, distortion=Distortion("brown_conrady", LENS))
RATIONAL = (0.3, 0.02, 1e-3, -2e-3, 0.001, 0.6, 0.05, 0.002)
FISHEYE = (-0.02, 0.01, -0.004, 0.0006)
POINTS = np.random.default_rng(1).uniform([20, 20], [620, 460], (200, 2))

SPANS = (0.15, 1.8), (-5, 35), (-5, 5), (-0.3, 0.3), (-0.2, 0.2)  # metres, degrees, degrees, metres, metres
mounts = st.builds(Mount.from_degrees, *(st.floats(*span) for span in SPANS))


def matrix(camera):
    return np.array([[camera.fx, 0, camera.cx], [0, camera.fy, camera.cy], [0, 0, 1.0]])


@pytest.mark.parametrize("coefficients", [(), LENS, (0.1, -0.2, 0.001, 0.002, 0.05)])
def test_projection_is_opencvs(coefficients):
    rng = np.random.default_rng(0)
    points = np.column_stack([rng.uniform(-1, 1, 200), rng.uniform(-0.8, 0.8, 200), np.ones(200)])
    points *= rng.uniform(0.5, 5, (200, 1))
    camera, zero = replace(PLAIN, distortion=Distortion("brown_conrady", coefficients)), np.zeros(3)
    reference, _ = cv2.projectPoints(points, zero, zero, matrix(camera), np.array(coefficients or [0.0] * 5))
    np.testing.assert_allclose(camera.project(points), reference.reshape(-1, 2), atol=1e-8)


@pytest.mark.parametrize("model", ["brown_conrady", "inverse_brown_conrady", "modified_brown_conrady"])
@given(st.floats(0, 639), st.floats(0, 479), st.floats(0.2, 20))
def test_pixel_to_ray_to_pixel_comes_back(model, u, v, depth):
    camera = replace(PLAIN, distortion=Distortion(model, LENS))
    np.testing.assert_allclose(camera.project(camera.rays([[u, v]]) * depth), [[u, v]], atol=1e-6)


@pytest.mark.parametrize(
    ("make", "values", "text"),
    [
        *((Intrinsics, {name: value}, f"{name} is {value}") for name, value in (
            ("fx", math.nan), ("fy", -1.0), ("cx", math.inf), ("width", 0), ("fx", 0.0), ("cy", math.nan),
        )),
        (Mount, {"height_m": -0.1}, "height is -0.1 m"),
        (Mount, {"height_m": 0.0}, "height is 0.0 m"),
        (Mount, {"height_m": math.nan}, "height_m is nan"),
        (Mount, {"height_m": 1.0, "pitch_rad": 2.0}, "pitch is 114.6 deg"),
        (
            FloorCamera, {"intrinsics": PLAIN, "mount": Mount.from_degrees(0.6, -25.0)},
            r"pitch -25.0 deg .* 22\.\d deg of view below .* no floor .* looks at the sky",
        ),
        (Distortion, {"model": "brown_conrady", "coefficients": (0.1,) * 6}, "has 6 coefficients"),
        (Distortion, {"model": "fisheye", "coefficients": ()}, "model 'fisheye' is not one of"),
    ],
)  # fmt: skip
def test_what_cannot_be_is_refused_by_name(make, values, text):
    some = {"width": 640, "height": 480, "fx": 500.0, "fy": 500.0, "cx": 320.0, "cy": 240.0}
    with pytest.raises(GeometryError, match=text):
        make(**(some if make is Intrinsics else {}) | values)


@pytest.mark.parametrize(("below_deg", "seen"), [(2.4, False), (3.3, True)])
def test_the_nearest_floor_seen_is_at_most_twenty_camera_heights_away(below_deg, seen):
    """An angle below the horizon of 2.86 degrees, whatever the length of the viewing ray."""
    lens = Intrinsics(320, 240, 150.0, 150.0, 159.5, 119.5)
    half_deg = math.degrees(math.atan2(lens.height - 1.0 - lens.cy, lens.fy))
    mount = Mount.from_degrees(0.6, below_deg - half_deg)
    if seen:
        assert FloorCamera(lens, mount).floor_points([[159.5, 239.0]])[0, 0] < 12.0
    else:
        with pytest.raises(GeometryError, match="within 20 camera heights"):
            FloorCamera(lens, mount)


def test_axes_of_a_level_camera_and_signs_of_pitch_and_roll():
    """Right in the picture is -y of the base, down is -z, into the picture is x (REP-103)."""
    np.testing.assert_allclose(Mount(1.0).rotation_base_optical() @ np.eye(3), [[0, 0, 1], [-1, 0, 0], [0, -1, 0]])
    looking = Mount.from_degrees(1.0, 30.0).rotation_base_optical() @ [0, 0, 1]
    assert looking == pytest.approx([math.cos(math.radians(30)), 0, -0.5])
    right = Mount.from_degrees(1.0, 0.0, 10.0).rotation_base_optical() @ [1, 0, 0]
    assert right[2] == pytest.approx(-math.sin(math.radians(10)))  # the right side sinks


@given(mounts, st.floats(0.5, 8), st.floats(-3, 3))
def test_floor_to_picture_to_floor_comes_back(mount, x, y):
    camera = FloorCamera(PLAIN, mount)
    pixel = camera.project(np.array([[x, y]]))
    if np.isfinite(pixel).all() and camera.below_horizon(pixel)[0]:
        np.testing.assert_allclose(camera.floor_points(pixel), [[x, y]], rtol=1e-6, atol=1e-6)


def test_floor_projection_is_opencvs_projection_of_the_same_scene():
    mount = Mount.from_degrees(0.6, 11.5, 3.0, 0.15, -0.05)
    rotation = mount.rotation_base_optical().T
    translation = -rotation @ mount.position_base_m()
    floor = np.array([[x, y, 0.0] for x in (1.5, 2.5, 4.0) for y in (-0.6, 0.0, 0.7)])
    pixels, _ = cv2.projectPoints(floor, cv2.Rodrigues(rotation)[0], translation, matrix(BENT), np.array(LENS))
    camera = FloorCamera(BENT, mount)
    np.testing.assert_allclose(camera.project(floor), pixels.reshape(-1, 2), atol=1e-7)
    np.testing.assert_allclose(camera.floor_points(pixels.reshape(-1, 2)), floor[:, :2], atol=1e-6)


@given(mounts, st.floats(0, 639))
def test_horizon_row_parts_floor_from_sky(mount, column):
    camera = FloorCamera(PLAIN, mount)
    row = camera.horizon_row(column)
    assert camera.below_horizon([[column, row - 0.01], [column, row + 0.01]]).tolist() == [False, True]
    assert np.isnan(camera.floor_points([[column, row - 0.01]])).all()


@pytest.mark.parametrize("column", [10.0, 319.5, 600.0])
def test_horizon_row_with_distortion_parts_floor_from_sky(column):
    camera = FloorCamera(BENT, Mount.from_degrees(0.6, 8.0, 2.0))
    row = camera.horizon_row(column)
    assert camera.below_horizon([[column, row - 0.2], [column, row + 0.2]]).tolist() == [False, True]


def test_a_horizon_outside_a_distorted_picture_is_where_a_plain_lens_has_it():
    """40 degrees down: no row of the picture meets it."""
    plain, distorted = (FloorCamera(lens, Mount.from_degrees(0.6, 40.0)) for lens in (PLAIN, BENT))
    assert plain.horizon_row() < 0.0
    assert distorted.horizon_row() == pytest.approx(plain.horizon_row())


@pytest.mark.parametrize(("tilt_deg", "height_m"), [(0.4, 0.01), (1.0, 0.0), (0.0, 0.02)])
def test_floor_covariance_matches_sampling(tilt_deg, height_m):
    rng = np.random.default_rng(2)
    mount = Mount.from_degrees(0.6, 11.5)
    noise = FloorNoise(math.radians(tilt_deg), height_m)
    pixel = np.array([420.0, 330.0])
    own, shared = floor_covariances(FloorCamera(PLAIN, mount), [pixel], [(2.0, 1.5)], noise)
    by_pixel = FloorCamera(PLAIN, mount).floor_points(pixel + rng.normal(0, (2.0, 1.5), (20000, 2)))
    np.testing.assert_allclose(own[0], np.cov(by_pixel.T), rtol=0.08, atol=2e-5)
    by_mount = [
        FloorCamera(PLAIN, Mount(0.6 + h, mount.pitch_rad + p, r)).floor_points([pixel])[0]
        for p, r, h in rng.normal(0, [noise.tilt_rad, noise.tilt_rad, noise.height_m], (4000, 3))
    ]
    np.testing.assert_allclose(shared[0], np.cov(np.transpose(by_mount)), rtol=0.12, atol=2e-5)


@pytest.mark.parametrize("pitch_rad", [0.0, 0.2, 0.8])
def test_where_a_ray_meets_the_floor_moves_as_the_mount_tilts(pitch_rad):
    def meets(roll_rad, more_rad):
        mount = Mount(0.5, pitch_rad + more_rad, roll_rad, 0.2, 0.1)
        return FloorCamera(PLAIN, mount).floor_points([[420.0, 330.0]])[0]

    e = 1e-6
    slopes = np.column_stack([meets(e, 0.0) - meets(-e, 0.0), meets(0.0, e) - meets(0.0, -e)]) / (2.0 * e)
    by_tilt = Mount(0.5, pitch_rad, 0.0, 0.2, 0.1).floor_by_tilt(meets(0.0, 0.0))
    np.testing.assert_allclose(by_tilt, slopes, rtol=1e-5)


def lens(distortion):
    return Intrinsics(640, 480, 300.0, 305.0, 310.0, 235.0, distortion)


def test_rational_and_fisheye_are_those_of_opencv():
    rational = lens(Distortion.named("rational_polynomial", RATIONAL))
    rays, zero = rational.rays(POINTS), np.zeros(3)
    pixels, _ = cv2.projectPoints(rays, zero, zero, matrix(lens(Distortion())), np.array(RATIONAL))
    np.testing.assert_allclose(pixels[:, 0], POINTS, atol=1e-6)
    fisheye = lens(Distortion.named("equidistant", FISHEYE))
    expected = cv2.fisheye.undistortPoints(POINTS[:, None], matrix(lens(Distortion())), np.array(FISHEYE))[:, 0]
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


@pytest.mark.parametrize("model", ["brown_conrady", "inverse_brown_conrady", "modified_brown_conrady"])
def test_projection_agrees_with_librealsense(model):
    """That rays are its inverse, a test above shows."""
    rs, coefficients = pytest.importorskip("pyrealsense2"), (-0.055, 0.064, 0.0009, -0.0006, -0.021)
    theirs = rs.intrinsics()
    theirs.width, theirs.height = 640, 480
    theirs.fx, theirs.fy, theirs.ppx, theirs.ppy = 615.2, 615.4, 321.1, 239.7
    theirs.model, theirs.coeffs = getattr(rs.distortion, model), list(coefficients)
    ours = Intrinsics(640, 480, 615.2, 615.4, 321.1, 239.7, Distortion(model, coefficients))
    rays = np.array([[x, y, 1.0] for x in np.linspace(-0.49, 0.49, 9) for y in np.linspace(-0.36, 0.36, 9)])
    expected = np.array([rs.rs2_project_point_to_pixel(theirs, ray.tolist()) for ray in rays])
    np.testing.assert_allclose(ours.project(rays), expected, atol=0.02)
