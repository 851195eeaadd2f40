"""camera.yaml: what it says comes back, and what cannot be is named."""

# pyright: reportOptionalMemberAccess=false

import math

import numpy as np
import pytest

from edgemap.geometry.camera.intrinsics import Distortion, Intrinsics
from edgemap.geometry.camera.mount import Mount, Platform
from edgemap.runtime.frames.errors import CameraError
from edgemap.runtime.inputs.drives.camera_yaml import read_camera_yaml, write_camera_yaml

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
    write_camera_yaml(tmp_path / "camera.yaml", lens, mount, 29.97, "-y")
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
    write_camera_yaml(again, file.intrinsics, file.mount, depth=file.depth)
    for found in (file.depth, read_camera_yaml(again).depth):
        assert found.intrinsics == Intrinsics(512, 424, 365.0, 366.0, 256.0, 212.0)
        assert found.position_m == pytest.approx([-0.05, 0.0, 0.01])
        assert found.rotation @ [1.0, 0.0, 0.0] == pytest.approx([half, half, 0.0])


def test_without_a_pose_the_depth_camera_is_where_the_lens_is(tmp_path):
    path = tmp_path / "camera.yaml"
    path.write_text(TEXT[:-1] + ", depth: {width: 320, height: 240, fx: 293.5, fy: 293.5, cx: 159.5, cy: 119.5}}")
    depth = read_camera_yaml(path).depth
    assert (depth.rotation == np.eye(3)).all()
    assert not depth.position_m.any()


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
    ],
)
def test_what_cannot_be_is_one_line_with_the_path(tmp_path, old, new, text):
    path = tmp_path / "camera.yaml"
    path.write_text(TEXT.replace(old, new, 1))
    with pytest.raises(CameraError, match=text) as caught:
        read_camera_yaml(path)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)
