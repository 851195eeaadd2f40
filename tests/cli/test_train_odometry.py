"""From drives with true poses to a bundle whose odometry runs, as a user types it; mistakes are one line."""

import json
from pathlib import Path

import cv2
import msgspec
import numpy as np
import pytest

pytest.importorskip("torch")

from support.textured_floor import seen_by

from edgemap import models
from edgemap.export.detector.network import load_detector, save_detector
from edgemap.geometry.camera.floor import FloorCamera
from edgemap.geometry.camera.intrinsics import Intrinsics
from edgemap.geometry.camera.mount import Mount
from edgemap.geometry.se2 import SE2
from edgemap.runtime.frames.trajectory import Trajectory
from edgemap.runtime.inputs.drives.own import write_drive

pytestmark = pytest.mark.slow
CAMERA = FloorCamera(Intrinsics(128, 96, 110.0, 110.0, 63.5, 47.5), Mount.from_degrees(0.5, 15.0, 0.0, 0.1))


@pytest.fixture(scope="module")
def floor_drive(tmp_path_factory):
    """Sixteen small pictures of a textured floor, driving and turning, with their poses."""
    folder = tmp_path_factory.mktemp("drive")
    (folder / "images").mkdir()
    poses = [SE2()]
    for index in range(16):
        cv2.imwrite(str(folder / f"images/{index:03d}.png"), seen_by(CAMERA, poses[-1]))
        poses.append(poses[-1] @ SE2(0.04, 0.0, 0.05))
    truth = Trajectory(np.arange(16) / 10.0, tuple(poses[:16]))
    write_drive(folder, CAMERA.intrinsics, CAMERA.mount, 10.0, truth)
    return folder


@pytest.fixture(scope="module")
def backbone(tmp_path_factory):
    """A detector's best.pt with a small input."""
    path = tmp_path_factory.mktemp("backbone") / "best.pt"
    model, manifest = load_detector(str(Path(models.__file__).parent / "edgemap-nano"))
    whole = manifest.detector

    def smaller(spec):
        return msgspec.structs.replace(spec, shape=(*spec.shape[:2], *(side * 96 // 416 for side in spec.shape[2:])))

    detector = msgspec.structs.replace(
        whole,
        input=msgspec.structs.replace(whole.input, width=96, height=96),
        heads=tuple(map(smaller, whole.heads)),
        features=tuple(map(smaller, whole.features)),
    )
    shapes = {spec.name: spec.shape for spec in (*detector.heads, *detector.features)} | {"image": (1, 3, 96, 96)}
    del model.graph.value_info[:]
    for value in (*model.graph.input, *model.graph.output):
        for axis, size in zip(value.type.tensor_type.shape.dim, shapes[value.name], strict=True):
            axis.dim_value = size
    save_detector(model, msgspec.structs.replace(manifest, detector=detector), path)
    return path


@pytest.fixture(scope="module")
def cache(tmp_path_factory):
    """Features of the drive, by whichever test computes them first."""
    return tmp_path_factory.mktemp("cache")


def test_train_export_and_run(edgemap, floor_drive, backbone, cache, tmp_path):
    data = f"drive:{floor_drive}"
    flags = ("--data", data, "--validation", data, "--backbone", backbone, "--length", "4")
    spent = ("--batch", "2", "--cache", cache, "-o", tmp_path / "run")
    result = edgemap.ok("train", "odometry", *flags, *spent, "--steps", "2")
    assert "16 frames of 1 drives to train on, 16 to validate on" in result.stdout
    assert {path.name for path in (tmp_path / "run").iterdir()} >= {"best.pt", "last.pt", "curves.csv"}
    features = list(cache.rglob("*.npy"))
    written = features[0].stat().st_mtime_ns
    result = edgemap.ok("train", "odometry", *flags, *spent, "--steps", "3", "--resume", "--bfloat16")
    assert "after 3 steps" in result.stdout or "after 2 steps" in result.stdout
    assert features[0].stat().st_mtime_ns == written, "features were computed anew"

    result = edgemap.ok("export", tmp_path / "run/best.pt", "-o", tmp_path / "bundle")
    assert "paper odometry" in result.stdout
    run = ("--bundle", tmp_path / "bundle", "--camera", data, "--odometry", "paper", "--out", tmp_path / "out")
    result = edgemap.ok("run", *run)
    assert len((tmp_path / "out/trajectory.tum").read_text().splitlines()) >= 16
    document = json.loads((tmp_path / "bundle/bundle.json").read_text())
    assert document["odometry"]["paper"]["trained"] is True
    assert document["measured"]["odometry.paper"]["training"]["drives"] == 1


@pytest.mark.parametrize(
    ("flags", "code", "message"),
    [
        (("--steps", "-1"), 2, "--steps -1"),
        (("--length", "1"), 2, "--length 1"),
        (("--rate", "-1"), 2, "--rate -1.0"),
        (("--head", "flow"), 2, "--head flow: the only learned odometry is paper"),
        (("--feature", "nose"), 1, "no tensor 'nose'"),
        (("--length", "40"), 1, "16 frames, sequences need 40"),
        (("--frames", "1"), 1, "16 pictures, wanted are those from 0 to 1"),
    ],
)
def test_mistakes_are_one_line(edgemap, floor_drive, backbone, cache, tmp_path, flags, code, message):
    data = f"drive:{floor_drive}"
    result = edgemap(
        "train", "odometry", "--data", data, "--validation", data, "--backbone", backbone,
        "--cache", cache, "-o", tmp_path / "run", *flags,
    )  # fmt: skip
    assert result.returncode == code, result.stderr
    (line,) = [line for line in result.stderr.splitlines() if line.strip().startswith("edgemap")]
    assert message in line
