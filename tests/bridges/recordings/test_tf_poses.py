"""Poses of a SLAM by the tf of its bag: its map frame, its corrections, and frames that are not joined."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("rosbags")

from support.ros_bag import camera_info, header, image, path, pose, tf, transform, write_bag

from edgemap.bridges.ros2.recordings.reader import open_reading
from edgemap.bridges.ros2.recordings.tf_poses import tf_poses
from edgemap.geometry.camera.mount import Mount
from edgemap.geometry.se2 import SE2
from edgemap.runtime.frames.errors import CameraError, OdometryError

T0, STEP = 1_700_000_000_000_000_000, 10**8
MOUNT = Mount.from_degrees(0.6, 11.5)
BGR = np.random.default_rng(2).integers(0, 256, (48, 64, 3), dtype=np.uint8)
START, DRIFT = SE2(3.0, -2.0, 1.0), SE2(0.002, 0.0, 0.0006)  # where it begins; odom's error a step


def step(index, parent, child, pose):
    part = transform(parent, child, (pose.x_m, pose.y_m, 0.0), (0.0, 0.0, math.degrees(pose.yaw_rad)))
    return replace(part, header=header(T0 + index * STEP, parent))


def drive(count=200, every=50):
    """True poses of the base, and the tf messages of a SLAM whose odom drifts at each step and that corrects itself at
    every so many."""
    true, odom, joined, messages = START, SE2(), START, []
    poses = [true]
    for index in range(count):
        if index:
            moved = SE2(0.05, 0.0, 0.03 * math.sin(index / 15))
            true, odom = true @ moved, odom @ moved @ DRIFT
            poses.append(true)
        if index % every == 0:
            joined = true @ odom.inverse()
        messages.append(tf(step(index, "map", "odom", joined), step(index, "odom", "base_link", odom)))
    return poses, [("/tf", T0 + index * STEP, message) for index, message in enumerate(messages)]


def read(folder, messages, frames="", first_s=T0 / 1e9):
    recording = open_reading(write_bag(folder, messages))
    return tf_poses(recording, frames, MOUNT, first_s)


def test_a_large_correction_reaches_back_and_a_small_one_beside_it_does_not(tmp_path):
    poses, messages = drive(100, 1000)
    jumps = {60: SE2(0.5, 0.0, 0.0), 61: SE2(0.001, 0.0, 0.0)}
    now = START
    for index in range(100):
        now = jumps[index] @ now if index in jumps else now
        messages[index][2].transforms[0] = step(index, "map", "odom", now)
    given = np.array([pose.vector() for pose in read(tmp_path / "bag", messages).trajectory.poses])
    raw = np.array([pose.vector() for pose in poses])
    assert given[0] == pytest.approx(raw[0])  # the start holds
    assert np.abs(np.diff(given[:, 0])).max() < 0.08  # and nothing jumps
    assert given[30, 0] - raw[30, 0] == pytest.approx(0.25, abs=0.06)


def with_paths(poses, messages, kind, every=50):
    """A path of every tenth pose twice a second: by its kind as a graph corrects them, or as tf has had them."""
    true, odom, joined, log = poses, [], [], []
    for _, _, message in messages:
        for step in message.transforms:
            place, turn = step.transform.translation, step.transform.rotation
            poses_of = joined if step.child_frame_id == "odom" else odom
            poses_of.append(SE2(place.x, place.y, 2.0 * math.atan2(turn.z, turn.w)))
        log.append(joined[-1] @ odom[-1])
    found = []
    for end in range(10, len(poses), 10):
        stamp_ns, corrected = T0 + end * STEP, end // every * every
        nodes = [true[i] if i <= corrected else log[i] for i in range(0, end + 1, 10)]
        nodes = {"log": log[: end + 1 : 10], "lens": [node @ SE2(0.3, 0.0, 0.0) for node in nodes]}.get(kind, nodes)
        own = [T0 + i * STEP if kind != "rtabmap" else stamp_ns for i in range(0, end + 1, 10)]
        nodes = [pose(*node.vector()) for node in nodes]
        message = path(stamp_ns, list(zip(own, nodes, strict=True)), "odom" if kind == "odom" else "map")
        found.append(("/mapPath", stamp_ns + 1, message))
    return sorted([*messages, *found], key=lambda row: row[1])


@pytest.mark.parametrize(("kind", "error_m"), [
    ("graph", 0.0015), ("rtabmap", 0.0015), ("log", 0.018), ("lens", 0.018), ("odom", 0.018),
])  # fmt: skip
def test_corrections_are_those_of_a_path_in_the_bag(tmp_path, kind, error_m, capsys):
    """Poses of the base that its corrections move; other paths are left alone, and four corrections of 0.1 m and 1.7
    degrees each are spread over the path before them."""
    poses, messages = drive()
    given = read(tmp_path / "bag", with_paths(poses, messages, kind))
    assert given.attitudes is None
    off = [(one.inverse() @ true).vector() for one, true in zip(given.trajectory.poses, poses, strict=True)]
    off = np.array(off)[:151]  # up to the last correction
    assert error_m / 2 < np.hypot(*off[:, :2].T).max() < error_m  # 0.13 without
    assert ("/mapPath has" in capsys.readouterr().err) == (error_m < 0.01)


@pytest.mark.parametrize(("frames", "message"), [
    ("world,base_link", "does not join world to base_link"), ("map,wheel", "does not join map to wheel"),
])  # fmt: skip
def test_frames_that_tf_does_not_join_are_named(tmp_path, frames, message):
    with pytest.raises(CameraError, match=message + r".*base_link, map, odom"):
        read(tmp_path / "bag", drive(10)[1], frames)
    with pytest.raises(OdometryError, match="the first picture: no pose at"):
        read(tmp_path / "late", drive(10)[1], first_s=T0 / 1e9 + 60.0)


def test_a_run_begins_where_the_slam_is_in_its_map(edgemap, tmp_path, monkeypatch):
    """Also where it begins a named map, and where it continues that."""
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path / "data"))
    poses, messages = drive(12)
    mount = tf(transform("base_link", "base_footprint", (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)),
               transform("base_footprint", "cam_optical", (0.0, 0.0, 0.6), (-101.5, 0.0, -90.0)))  # fmt: skip
    k = [58.0, 0.0, 31.5, 0.0, 58.0, 23.5, 0.0, 0.0, 1.0]
    messages = [("/tf_static", T0, mount), ("/camera_info", T0, camera_info(64, 48, k, [0.0] * 5)), *messages]
    messages += [("/image", T0 + i * STEP, image(T0 + i * STEP, np.roll(BGR, i), "bgr8")) for i in range(12)]
    path = write_bag(tmp_path / "bag", messages)
    for name, options in (("run", ()), ("new", ("--map", "home")), ("again", ("--map", "home"))):
        out = tmp_path / name
        edgemap.ok("run", "--camera", path, "--odometry", "tf", "--out", out, *options)
        rows = np.loadtxt(out / "trajectory.tum")
        assert rows[0, 1:3] == pytest.approx(START.vector()[:2], abs=1e-3)
        assert rows[-1, 1:3] == pytest.approx(poses[-1].vector()[:2], abs=0.05)
        assert json.loads((out / "run.json").read_text())["odometry"] == "tf"
    wrong = edgemap("run", "--camera", "demo", "--odometry", "tf", "--out", tmp_path / "none")
    assert wrong.returncode == 1
    assert "has no tf" in wrong.stderr
