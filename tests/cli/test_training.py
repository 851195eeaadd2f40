"""From drives and labelled pictures to a bundle that runs and its figures, as a user types it."""

import contextlib
import io
import json
import shlex
import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest
from support.refusal import one_line

pytest.importorskip("torch")

from support.textured_floor import seen_by

from edgemap.cli import main
from edgemap.export import parity
from edgemap.geometry.camera.floor import FloorCamera
from edgemap.geometry.camera.intrinsics import Intrinsics
from edgemap.geometry.camera.mount import Mount
from edgemap.geometry.se2 import SE2
from edgemap.runtime.frames.trajectory import Trajectory
from edgemap.runtime.inputs.drives import CameraFile, write_drive

pytestmark = pytest.mark.slow
ROOT = Path(__file__).parents[2]
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
    write_drive(folder, CameraFile(CAMERA.intrinsics, CAMERA.mount, 10.0), truth)
    return folder


def test_an_odometry_is_trained_exported_and_run(edgemap, floor_drive, tmp_path):
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
    assert features[0].stat().st_mtime_ns == written, "features were computed again"
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


@pytest.fixture
def carpets(tmp_path):
    """Four pictures of a speckled carpet below a plain wall, at many heights."""
    folder = tmp_path / "carpets"
    (folder / "images").mkdir(parents=True)
    (folder / "floor").mkdir()
    generator = np.random.default_rng(0)
    for number in range(4):
        row = int(generator.integers(60, 160))
        picture = np.full((240, 320, 3), generator.integers(150, 220, 3), np.uint8)
        picture[row:] = cv2.resize(generator.integers(0, 120, (60, 80, 3), np.uint8), (320, 240))[: 240 - row]
        labels = np.full((240, 320), 2, np.uint8)
        labels[row:] = 1
        cv2.imwrite(str(folder / f"images/{number}.png"), picture)
        cv2.imwrite(str(folder / f"floor/{number}.png"), labels)
    return folder


def test_a_floor_head_is_trained_exported_and_judged(edgemap, carpets, tmp_path):
    data = f"floor:{carpets}"
    trained = ("--data", data, "--validation", data, "--backbone", "edgemap-nano", "--rate", "0.01")
    brief = ("--epochs", "8", "--batch", "4", "--views", "1")
    edgemap.ok("train", "floor", *trained, *brief, "--source", "labels by hand", "-o", tmp_path / "out")
    head = tmp_path / "out" / "best.pt"
    assert edgemap("export", head, "-o", tmp_path / "bundle").returncode == 0
    manifest = json.loads((tmp_path / "bundle" / "bundle.json").read_text())
    assert manifest["detector"]["floor"]["labels"] == ["floor", "wall"]
    assert "labels by hand" in manifest["sources"]
    assert manifest["measured"]["floor"]["parameters"] > 0
    result = edgemap("eval", "floor", "--data", data, "--bundle", tmp_path / "bundle", "--json")
    figures = json.loads(result.stdout)
    assert figures["pictures"] == 4
    assert figures["iou"] > 0.8
    assert figures["contact_m"] is None
    picture = carpets / "images" / "0.png"
    edgemap.ok("detect", picture, "--bundle", tmp_path / "bundle", "--plot", tmp_path / "p")
    drawn, plain = (cv2.imread(str(path)) for path in (tmp_path / "p" / "0.png", picture))
    tint = drawn.astype(int) - plain
    assert tint[-40:, :, 1].mean() > 10  # the floor is green
    assert tint[:40, :, 0].mean() > tint[:40, :, 1].mean()  # the wall blue


@pytest.fixture(scope="module")
def squares(tmp_path_factory):
    """Ten pictures of one white square each, labelled a chair; the last one is too hidden to be asked for."""
    folder = tmp_path_factory.mktemp("squares")
    (folder / "images").mkdir()
    generator, frames = np.random.default_rng(0), []
    for number in range(10):
        picture = np.full((96, 96, 3), 40, np.uint8)
        x, y = (int(v) for v in generator.integers(0, 50, 2))
        picture[y : y + 40, x : x + 40] = 255
        cv2.imwrite(str(folder / f"images/{number}.png"), picture)
        visible = 0.1 if number == 9 else 1.0
        frames.append([{"id": 1, "label": "chair", "box": [x, y, x + 40, y + 40], "visible": visible}])
    (folder / "boxes.json").write_text(json.dumps({"frames": frames}))
    return folder


@pytest.fixture(scope="module")
def flat(squares, tmp_path_factory):
    """The commands of docs/train.md as they stand, on three sets of four squares with the labels and classes.txt of
    a labelling tool: the folder that they leave, and what they print."""
    page = (ROOT / "docs/train.md").read_text().split("## Your own flat")[1]
    commands, place = page.split("```sh\n")[1].split("```")[0].splitlines(), tmp_path_factory.mktemp("flat")
    folders = [place / "flat" / part for part in ("mine", "choose", "other")]
    for folder in (*(one / "images" for one in folders), place / "photographs"):
        folder.mkdir(parents=True)
        for number in range(4):
            shutil.copy(squares / f"images/{number}.png", folder)
    for folder in folders:
        (folder / "labels").mkdir()
        (folder / "labels/classes.txt").write_text("couch\nchair\n")
        for number, ((box,),) in enumerate(zip(json.loads((squares / "boxes.json").read_text())["frames"][:4])):
            centre = [(box["box"][axis] + 20) / 96 for axis in (0, 1)]
            (folder / f"labels/{number}.txt").write_text(f"1 {centre[0]} {centre[1]} {40 / 96} {40 / 96}\n")
    (place / "models").symlink_to(ROOT / "models")
    ran = [shlex.split(line.split(" #")[0])[1:] for line in commands if "realsense" not in line]
    assert [words[0] for words in ran] == ["eval", "train", "export", "eval"]
    small = ["--epochs", "1", "--input", "128", "--batch", "4", "--validate-minutes", "9", "--validate-pictures", "3"]
    ran[1] += small  # some seconds of the page's minute
    printed = io.StringIO()
    with pytest.MonkeyPatch.context() as patch, contextlib.redirect_stdout(printed):
        patch.chdir(place)
        patch.setattr(parity, "CASES", 1)
        patch.setattr(parity, "STEPS", 2)
        for words in ran:
            main(words)
    return place, printed.getvalue()


def test_the_page_s_commands_train_a_bundle(flat):
    place, printed = flat
    assert "8 pictures with 4 boxes to train on, 3 to validate on" in printed
    assert {path.name for path in (place / "flat/trained").iterdir()} >= {"best.pt", "blended.pt", "last.pt"}
    assert len((place / "flat/trained/curves.csv").read_text().splitlines()) >= 2
    assert (place / "my-flat/backbone.onnx").is_file()


def test_a_trained_bundle_is_judged_and_a_checkpoint_is_a_detector_itself(edgemap, flat, squares, tmp_path, capsys):
    place, _ = flat
    flags = ("eval", "detection", "--data", f"yolo:{squares}", "--bundle", place / "my-flat", "--json")
    figures = json.loads(edgemap(*flags).stdout)
    assert (figures["pictures"], figures["boxes_true"], figures["boxes_ignored"]) == (10, 9, 1)
    assert "the bundle knows person" in one_line(edgemap(*flags, "--classes", "sofa"), 2)
    with pytest.raises(SystemExit) as ended:
        main(["export", str(place / "flat/trained/best.pt"), "--backbone", "yolov3", "-o", str(tmp_path / "x")])
    assert ended.value.code == 2
    assert "is a detector itself" in capsys.readouterr().err
    data = f"yolo:{squares}"
    train = ("train", "detector", "--data", data, "--validation", data, "-o", tmp_path / "none")
    assert "last.pt: no such checkpoint" in one_line(edgemap(*train, "--resume"))
