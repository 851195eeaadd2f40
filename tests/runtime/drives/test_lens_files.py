"""Camera files: our own, and those of other programs as these write them."""

import json
import math

import cv2
import numpy as np
import pytest

from edgemap.geometry.camera.intrinsics import Distortion, Intrinsics
from edgemap.geometry.camera.mount import Mount, Platform
from edgemap.runtime.frames.errors import CameraError
from edgemap.runtime.inputs.drives.camera_yaml import CameraFile, read_camera_yaml, write_camera_yaml

ROS = """image_width: 640
image_height: 480
camera_name: narrow_stereo
camera_matrix:
  rows: 3
  cols: 3
  data: [430.2, 0.0, 306.7, 0.0, 430.5, 227.2, 0.0, 0.0, 1.0]
distortion_model: {model}
distortion_coefficients:
  rows: 1
  cols: {count}
  data: {data}
rectification_matrix: {{rows: 3, cols: 3, data: [1, 0, 0, 0, 1, 0, 0, 0, 1]}}
projection_matrix: {{rows: 3, cols: 4, data: [400, 0, 300, 0, 0, 400, 220, 0, 0, 0, 1, 0]}}
"""
KALIBR = """cam0:
  cam_overlaps: [1]
  camera_model: {camera}
  distortion_coeffs: [-0.01, 0.02, -0.003, 0.0004]
  distortion_model: {model}
  intrinsics: [430.2, 430.5, 306.7, 227.2]
  resolution: [640, 480]
  rostopic: /cam0/image_raw
cam1:
  camera_model: pinhole
  intrinsics: [1.0, 1.0, 1.0, 1.0]
  distortion_model: radtan
  distortion_coeffs: [0.0, 0.0, 0.0, 0.0]
  resolution: [640, 480]
"""
ORB = """%YAML:1.0

#--------------------------------------------------------------------------------------------
Camera.type: "{kind}"
{prefix}.fx: 430.2
{prefix}.fy: 430.5
{prefix}.cx: 306.7
{prefix}.cy: 227.2
{prefix}.k1: -0.01
{prefix}.k2: 0.02
{prefix}.{third}: -0.003
{prefix}.{fourth}: 0.0004
Camera.fps: 30
{size}
ORBextractor.nFeatures: 1000
"""
SIZE = "Camera.width: 640\nCamera.height: 480"
COLMAP = "# Camera list with one line of data per camera:\n#   CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]\n"
NERF = {
    "w": 640, "h": 480, "fl_x": 430.2, "fl_y": 430.5, "cx": 307.2, "cy": 227.7, "k1": -0.01, "k2": 0.02, "frames": [],
}  # fmt: skip


FOUR, FISH, ROUND = "640 480 430.2 430.5 307.2 227.7", {"camera_model": "OPENCV_FISHEYE"}, {"camera_model": "SPHERE"}


def orb(kind="PinHole", prefix="Camera", letter="p", size=SIZE):
    third, fourth = ("p1", "p2") if letter == "p" else ("k3", "k4")
    return ORB.format(kind=kind, prefix=prefix, third=third, fourth=fourth, size=size)


def opencv(path, coefficients, **more):
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    for name, value in more.items():
        storage.write(name, value)
    storage.write("camera_matrix", np.array([[430.2, 0.0, 306.7], [0.0, 430.5, 227.2], [0.0, 0.0, 1.0]]))
    storage.write("distortion_coefficients", np.array(coefficients)[None])
    storage.release()
    return path.read_text()


PLAIN = "height: 480\nwidth: 640\n"
MATRIX = [430.2, 0.0, 306.7, 0.0, 430.5, 227.2, 0.0, 0.0, 1.0]
# As `ros2 topic echo` prints a CameraInfo.
ECHO = (
    PLAIN
    + """distortion_model: plumb_bob
d: [-0.01, 0.02, -0.003, 0.0004, 0.0]
k: {matrix}
binning_x: {binning}
roi:
  x_offset: 0
---
"""
)
TRANSPOSED = np.reshape(MATRIX, (3, 3)).T.ravel().tolist()
K4, SIX = (-0.01, 0.02, -0.003, 0.0004), {"image_width": 640, "image_height": 480}
ROWS = f"{PLAIN}K: [[430.2, 0, 306.7], [0, 430.5, 227.2], [0, 0, 1]]\ndist_coeff: [{[*K4]}]\n"


@pytest.mark.parametrize(
    ("name", "content", "model", "coefficients"),
    [
        ("ost.yaml", ROS.format(model="plumb_bob", count=5, data=[*K4, 0.0]), "brown_conrady", (*K4, 0.0)),
        ("fish.yaml", ROS.format(model="equidistant", count=4, data=[0.0] * 4), "equidistant", ()),
        ("wide.yaml", ROS.format(model="rational_polynomial", count=8, data=[0.1] * 8), "rational", (0.1,) * 8),
        ("camchain.yaml", KALIBR.format(camera="pinhole", model="radtan"), "brown_conrady", K4),
        ("camchain.yaml", KALIBR.format(camera="pinhole", model="equidistant"), "equidistant", K4),
        ("orb2.yaml", orb(), "brown_conrady", None),
        ("orb3.yaml", orb("KannalaBrandt8", "Camera1", "k"), "equidistant", K4),
        ("cameras.txt", COLMAP + f"1 OPENCV {FOUR} -0.01 0.02 -0.003 0.0004\n", "brown_conrady", None),
        ("cameras.txt", COLMAP + f"1 OPENCV_FISHEYE {FOUR} 0 0 0 0\n", "equidistant", ()),
        ("cameras.txt", COLMAP + f"1 PINHOLE {FOUR}\n", "none", ()),
        ("transforms.json", json.dumps(NERF | FISH), "equidistant", (-0.01, 0.02, 0.0, 0.0)),
        ("transforms.json", json.dumps(NERF | {"is_fisheye": True}), "equidistant", (-0.01, 0.02, 0.0, 0.0)),
        ("transforms.json", json.dumps(NERF | {"p1": -0.003, "p2": 0.0004}), "brown_conrady", None),
        ("echo.yaml", ECHO.format(matrix=MATRIX, binning=0), "brown_conrady", (*K4, 0.0)),
        ("rows.yaml", ROWS, "brown_conrady", None),
        ("calib.yml", lambda path: opencv(path, [*K4, 0.0], **SIX), "brown_conrady", (*K4, 0.0)),
        ("fish.yml", lambda path: opencv(path, K4, fisheye_model=1, **SIX), "equidistant", K4),
        ("wide.yml", lambda path: opencv(path, [0.1] * 8, **SIX), "rational", (0.1,) * 8),
    ],
)
def test_lenses_of_other_programs(tmp_path, name, content, model, coefficients):
    path = tmp_path / name
    path.write_text(content(path) if callable(content) else content)
    lens = read_camera_yaml(path).intrinsics
    assert (lens.width, lens.height) == (640, 480)
    assert (lens.fx, lens.fy, lens.cx, lens.cy) == pytest.approx((430.2, 430.5, 306.7, 227.2))
    assert lens.distortion.model == model
    found = (*lens.distortion.coefficients, *[0.0] * 8)
    np.testing.assert_allclose(found[:8], ((*(K4 if coefficients is None else coefficients), *[0.0] * 8))[:8])


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("ost.yaml", ROS.format(model="double_sphere", count=4, data=[0.0] * 4), "'double_sphere' with 4 coefficients"),
        ("camchain.yaml", KALIBR.format(camera="omni", model="radtan"), "camera_model 'omni' is not supported"),
        ("camchain.yaml", KALIBR.format(camera="pinhole", model="fov"), "distortion 'fov'"),
        ("orb.yaml", orb(size=""), "add Camera.width: 640"),
        ("cameras.txt", COLMAP + "1 THIN_PRISM_FISHEYE 640 480 1 2 3\n", "'THIN_PRISM_FISHEYE' is not supported"),
        ("cameras.txt", COLMAP + "1 PINHOLE 640 480 1 1 3 3\n2 PINHOLE 640 480 2 2 3 3\n", "2 cameras in it; leave"),
        ("cameras.txt", COLMAP + "1 PINHOLE 640 480 1 1 3\n", "not a camera file that is read"),
        ("transforms.json", json.dumps(NERF | ROUND), "'SPHERE' is not supported"),
        ("transforms.json", json.dumps(NERF | {"frames": [{"w": 1}, {"w": 2}]}), "several lenses"),
        ("transforms.json", "{", "not JSON"),
        ("echo.yaml", ECHO.format(matrix=MATRIX, binning=2), "binned"),
        ("echo.yaml", ECHO.format(matrix=TRANSPOSED, binning=0), "expected fx, 0, cx"),
        ("plain.yaml", f"{PLAIN}K: {MATRIX}\n", "lacks the distortion"),
        ("cameras.txt", COLMAP + "1 PINHOLE 1e9 480 1 1 3 3\n", "size"),
        ("calib.yml", lambda path: opencv(path, K4), "add image_width: 640"),
        ("calib.yml", "%YAML:1.0\ncamera_matrix: !!opencv-matrix\n  rows: [", "not YAML"),
        ("calib.xml", "<opencv_storage/>", "XML is not read"),
        ("ost.yaml", ROS.format(model="plumb_bob", count=5, data=["x"] * 5), "not a camera file that is read"),
    ],
)
def test_what_is_not_supported_is_named_in_one_line(tmp_path, name, content, words):
    path = tmp_path / name
    path.write_text(content(path) if callable(content) else content)
    with pytest.raises(CameraError, match=name) as refused:
        read_camera_yaml(path)
    assert words in str(refused.value)
    assert "\n" not in str(refused.value)


TEXT = """{width: 640, height: 480, fx: 587.0, fy: 587.0, cx: 319.5, cy: 239.5,
 distortion: {model: none, coefficients: []},
 fps: 10.0, world_up: z, mount: {height_m: 0.60, pitch_deg: 11.5, roll_deg: 0.0, forward_m: 0.15, left_m: 0.0}}"""

DEPTH = "depth: {width: 640, height: 480, fx: 585.0, fy: 585.0, cx: 320.0, cy: 240.0"


def test_the_documented_file_is_read(tmp_path):
    path = tmp_path / "camera.yaml"
    path.write_text(TEXT)
    file = read_camera_yaml(path)
    assert file.intrinsics == Intrinsics(640, 480, 587.0, 587.0, 319.5, 239.5)
    assert file.mount == Mount.from_degrees(0.6, 11.5, forward_m=0.15)
    assert (file.rate_hz, file.world_up) == (10.0, "z")


def test_what_is_written_is_read_back(tmp_path):
    lens = Intrinsics(640, 480, 615.2, 615.4, 321.1, 239.7, Distortion("brown_conrady", (0.1, -0.2, 1e-5, -2e-3, 0.03)))
    mount = Mount.from_degrees(0.42, 17.3, -1.5, 0.1, -0.03, Platform.CAR)
    write_camera_yaml(tmp_path / "camera.yaml", CameraFile(lens, mount, 29.97, "-y"))
    file = read_camera_yaml(tmp_path / "camera.yaml")
    assert file.intrinsics == lens
    assert (file.mount.pitch_rad, file.mount.roll_rad) == pytest.approx((mount.pitch_rad, mount.roll_rad), abs=1e-12)
    assert (file.rate_hz, file.world_up, file.mount.platform) == (29.97, "-y", Platform.CAR)


def test_a_depth_camera_of_its_own_is_read_back(tmp_path):
    """Half a quarter turn about the optical axis: what is right of the depth camera is below right of the lens."""
    half = math.sqrt(0.5)
    path, again = tmp_path / "camera.yaml", tmp_path / "again.yaml"
    depth = "depth: {width: 512, height: 424, fx: 365.0, fy: 366.0, cx: 256.0, cy: 212.0, position_m: [-0.05, 0, 0.01],"
    turned = math.sin(math.pi / 8), math.cos(math.pi / 8)
    path.write_text(TEXT[:-1] + f", {depth} quaternion_xyzw: [0, 0, {turned[0]}, {turned[1]}]}}}}")
    file = read_camera_yaml(path)
    write_camera_yaml(again, file)
    for found in (file.depth, read_camera_yaml(again).depth):
        assert found.intrinsics == Intrinsics(512, 424, 365.0, 366.0, 256.0, 212.0)
        assert found.position_m == pytest.approx([-0.05, 0.0, 0.01])
        assert found.rotation @ [1.0, 0.0, 0.0] == pytest.approx([half, half, 0.0])
    path.write_text(f"{TEXT[:-1]}, {DEPTH}}}}}")  # without a pose it is where the lens is
    found = read_camera_yaml(path).depth
    assert (found.rotation == np.eye(3)).all()
    assert not found.position_m.any()


@pytest.mark.parametrize(
    ("old", "new", "text"),
    [
        ("fx: 587.0", "fx: .nan", r"\$\.fx`, found nan"),
        ("fx: 587.0", "fx: -3.0", r"> 0.0 - at `\$\.fx`, found -3.0"),
        ("fx: 587.0", "fx: wide", r"\$\.fx"),
        ("width: 640, ", "", "missing required field `width`"),
        ("fx: 587.0", "fx: 587.0, focus: 3", "unknown field `focus`"),
        ("height_m: 0.60", "height_m: -0.2", r"> 0.0 - at `\$\.mount\.height_m`, found -0.2"),
        ("pitch_deg: 11.5", "pitch_deg: .nan", r"\$\.mount\.pitch_deg`, found nan"),
        ("fps: 10.0", "fps: 0", r"> 0.0 - at `\$\.fps`, found 0"),
        ("world_up: z", "world_up: up", r"\$\.world_up`, found 'up'"),
        ("model: none", "model: fisheye", "distortion model 'fisheye'"),
        ("fps: 10.0", f"{DEPTH}, quaternion_xyzw: [0, 0, 0, 0.9]}}", "quaternion_xyzw has length 0.9000, expected 1"),
        ("fps: 10.0", f"{DEPTH}, position_m: [0, .nan, 0]}}", r"\$\.depth\.position_m\[1\]`, found nan"),
        ("{width", "{{width", "not YAML"),
        ("{width", "{" * 5000 + "width", "not YAML"),
        ("fx: 587.0", "fx: " + "9" * 5000, "not YAML"),
        ("fps: 10.0", "calibration: !!python/object:os.system {}", "could not determine a constructor"),
        ("fps: 10.0", "a: &a [x], b: [*a, *a]", "an alias"),
        ("model: none, coefficients: []", "model: brown_conrady, coefficients: [1,2,3,4,5,6]", "coefficients"),
        ("width: 640", "width: 100000", "width`, found 100000"),
        (TEXT, "", "Expected `object`"),
    ],
)
def test_what_cannot_be_is_one_line_with_the_path(tmp_path, old, new, text):
    path = tmp_path / "camera.yaml"
    path.write_text(TEXT.replace(old, new, 1))
    with pytest.raises(CameraError, match=text) as caught:
        read_camera_yaml(path)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)
