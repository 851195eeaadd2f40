"""calibrate as a user types it: lens, then mount, into one camera.yaml that run reads; and refusals in one line."""

from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml
from support.depth_room import depth_room
from support.scenes import floor_board, held_board

from edgemap.geometry.camera.depth_camera import DepthCamera
from edgemap.geometry.camera.floor import FloorCamera
from edgemap.geometry.camera.intrinsics import Intrinsics
from edgemap.geometry.camera.mount import Mount
from edgemap.runtime.inputs.drives.camera_yaml import CameraFile, read_camera_yaml, write_camera_yaml

LENS = Intrinsics(640, 480, 520.0, 523.0, 315.0, 243.0)
MOUNT = Mount.from_degrees(0.52, 22.0, 1.5)


@pytest.fixture(scope="module")
def boards(tmp_path_factory):
    """Folders `held` and `lying` of pictures."""
    folder = tmp_path_factory.mktemp("boards")
    (folder / "held").mkdir()
    (folder / "lying").mkdir()
    turns = [(25, 0, 0), (-25, 0, 5), (0, 25, 0), (0, -25, -5), (20, 20, 0), (-20, 20, 3), (20, -20, 0), (0, 0, 0)]
    corners = [(-0.11, -0.07), (0.11, -0.07), (-0.11, 0.07), (0.11, 0.07)]
    for i in range(10):
        place = (*corners[i % 4], 0.42 + 0.02 * (i % 3))
        cv2.imwrite(str(folder / "held" / f"{i}.png"), held_board(LENS, place, turns[i % 8], i))
    for i, (place, yaw) in enumerate([((1.0, 0.1), 0.3), ((1.1, -0.3), 1.2), ((1.1, 0.3), -0.5), ((0.9, 0.0), 2.0)]):
        cv2.imwrite(str(folder / "lying" / f"{i}.png"), floor_board(FloorCamera(LENS, MOUNT), place, yaw, i))
    return folder


def test_lens_then_mount_into_one_file(edgemap, boards, tmp_path):
    out = tmp_path / "camera.yaml"
    result = edgemap.ok("calibrate", "intrinsics", "--camera", boards / "held", "--board", "9x6", "-o", out)
    lens = read_camera_yaml(out).intrinsics
    assert (lens.fx, lens.fy) == pytest.approx((LENS.fx, LENS.fy), rel=4e-3)
    assert f"fx {lens.fx:8.2f} +-" in result.stdout

    flags = ("--board", "9x6", "--square", "0.06", "--camera-file", out, "-o", out)
    result = edgemap.ok("calibrate", "mount", "--camera", boards / "lying", *flags)
    file = read_camera_yaml(out)
    assert file.intrinsics == lens
    assert file.mount.height_m == pytest.approx(0.52, abs=0.006)
    assert np.degrees(file.mount.pitch_rad) == pytest.approx(22.0, abs=0.3)
    assert np.degrees(file.mount.roll_rad) == pytest.approx(1.5, abs=0.2)
    assert set(file.calibration) == {"intrinsics", "mount"}
    assert file.calibration["mount"]["views"] == 4
    assert file.calibration["intrinsics"]["rms_px"] < 0.2


def test_tilt_of_the_demo_keeps_the_rest(edgemap, tmp_path):
    out = tmp_path / "camera.yaml"
    edgemap.ok("calibrate", "tilt", "--camera", "demo", "--frames", "120", "--height", "0.7", "-o", out)
    demo = read_camera_yaml(Path(__file__).parents[2] / "runtime" / "inputs" / "demo" / "camera.yaml")
    found = read_camera_yaml(out)
    assert found.intrinsics == demo.intrinsics
    assert (found.mount.height_m, found.mount.forward_m) == (0.7, demo.mount.forward_m)
    off = [found.mount.pitch_rad - demo.mount.pitch_rad, found.mount.roll_rad - demo.mount.roll_rad]
    assert np.degrees(off) == pytest.approx([0.0, 0.0], abs=0.3)
    assert yaml.safe_load(out.read_text())["calibration"]["tilt"]["sigma_pitch_deg"] < 0.3


def test_mount_of_the_demo_without_pattern_or_ruler(edgemap, tmp_path):
    out = tmp_path / "camera.yaml"
    result = edgemap.ok("calibrate", "mount", "--camera", "demo", "-o", out)
    assert "windows of wheel travel" in result.stdout
    demo = read_camera_yaml(Path(__file__).parents[2] / "runtime" / "inputs" / "demo" / "camera.yaml").mount
    found = read_camera_yaml(out).mount
    assert found.height_m == pytest.approx(demo.height_m, rel=0.02)
    assert np.degrees(found.pitch_rad - demo.pitch_rad) == pytest.approx(0.0, abs=0.3)
    assert (found.forward_m, found.left_m) == (demo.forward_m, demo.left_m)


def test_mount_of_a_drive_with_depth(edgemap, tmp_path):
    drive = tmp_path / "drive"
    (drive / "images").mkdir(parents=True)
    (drive / "depth").mkdir()
    for i in range(4):
        cv2.imwrite(str(drive / "images" / f"{i}.png"), np.full((480, 640, 3), 90, np.uint8))
        millimetres = np.round(1000.0 * depth_room(MOUNT, LENS)).astype(np.uint16)
        cv2.imwrite(str(drive / "depth" / f"{i}.png"), millimetres)
    (drive / "poses.tum").write_text("".join(f"{i / 10} 0 0 0 0 0 0 1\n" for i in range(4)))
    lens = drive / "camera.yaml"
    write_camera_yaml(lens, CameraFile(LENS, depth=DepthCamera(LENS)))  # of its own, where the lens is
    out = tmp_path / "out.yaml"
    result = edgemap.ok("calibrate", "mount", "--camera", f"drive:{drive}", "--camera-file", lens, "-o", out)
    assert "4 of 4 depth pictures show a floor" in result.stdout
    found = read_camera_yaml(out)
    assert found.mount.height_m == pytest.approx(0.52, abs=0.003)
    assert np.degrees(found.mount.roll_rad) == pytest.approx(1.5, abs=0.1)
    assert found.calibration["mount"]["method"] == "floor in depth pictures"
    assert found.depth.intrinsics == LENS


def test_mount_takes_the_wheels_of_the_topic_that_is_named(edgemap, tmp_path):
    pytest.importorskip("mcap")
    path = tmp_path / "a.mcap"
    assert edgemap("record", "--camera", "demo", "--frames", "45", "-o", path).returncode == 0
    found = edgemap("calibrate", "mount", "--camera", path, "--topics", "wheels=/none", "-o", tmp_path / "camera.yaml")
    assert found.returncode == 1
    assert "no nav_msgs/Odometry topic /none (there are: /wheel/odometry)" in found.stderr
