"""From drives with true poses to a bundle whose odometry runs, as a user types it."""

import json

import cv2
import numpy as np
import pytest

pytest.importorskip("torch")

from support.textured_floor import seen_by

from edgemap.geometry.camera.floor import FloorCamera
from edgemap.geometry.camera.intrinsics import Intrinsics
from edgemap.geometry.camera.mount import Mount
from edgemap.geometry.se2 import SE2
from edgemap.runtime.frames.trajectory import Trajectory
from edgemap.runtime.inputs.drives.own import write_drive

pytestmark = pytest.mark.slow
CAMERA = FloorCamera(Intrinsics(128, 96, 110.0, 110.0, 63.5, 47.5), Mount.from_degrees(0.5, 15.0, 0.0, 0.1))


@pytest.fixture
def floor_drive(tmp_path):
    """Sixteen small pictures of a textured floor, driving and turning, with their poses."""
    folder = tmp_path / "drive"
    (folder / "images").mkdir(parents=True)
    poses = [SE2()]
    for index in range(16):
        cv2.imwrite(str(folder / f"images/{index:03d}.png"), seen_by(CAMERA, poses[-1]))
        poses.append(poses[-1] @ SE2(0.04, 0.0, 0.05))
    truth = Trajectory(np.arange(16) / 10.0, tuple(poses[:16]))
    write_drive(folder, CAMERA.intrinsics, CAMERA.mount, 10.0, truth)
    return folder


def test_train_export_and_run(edgemap, floor_drive, tmp_path):
    data, cache = f"drive:{floor_drive}", tmp_path / "cache"
    flags = ("--data", data, "--validation", data, "--backbone", "edgemap-nano", "--length", "4")
    spent = ("--batch", "2", "--cache", cache, "-o", tmp_path / "run")
    result = edgemap.ok("train", "odometry", *flags, *spent, "--steps", "2")
    assert "16 frames of 1 drives to train on, 16 to validate on" in result.stdout
    assert {path.name for path in (tmp_path / "run").iterdir()} >= {"best.pt", "last.pt", "curves.csv"}
    features = list(cache.rglob("*.npy"))
    written = features[0].stat().st_mtime_ns
    result = edgemap.ok("train", "odometry", *flags, *spent, "--steps", "3", "--resume", "--bfloat16")
    assert "after 3 steps" in result.stdout or "after 2 steps" in result.stdout
    assert features[0].stat().st_mtime_ns == written, "features were computed anew"
    short = edgemap("train", "odometry", *flags[:-1], "40", *spent[:-1], tmp_path / "none")
    assert (short.returncode, "16 frames, sequences need 40" in short.stderr) == (1, True)

    result = edgemap.ok("export", tmp_path / "run/best.pt", "-o", tmp_path / "bundle")
    assert "paper odometry" in result.stdout
    run = ("--bundle", tmp_path / "bundle", "--camera", data, "--odometry", "paper", "--out", tmp_path / "out")
    result = edgemap.ok("run", *run)
    assert len((tmp_path / "out/trajectory.tum").read_text().splitlines()) >= 16
    document = json.loads((tmp_path / "bundle/bundle.json").read_text())
    assert document["odometry"]["paper"]["trained"] is True
    assert document["measured"]["odometry.paper"]["training"]["drives"] == 1
