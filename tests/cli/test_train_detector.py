"""From labelled pictures to a bundle's figures, as a user types it; mistakes are one line."""

import json

import cv2
import numpy as np
import pytest

pytest.importorskip("torch")


def one_line(result):
    """The single line of a known failure."""
    assert result.returncode == 1, result.stderr
    (line,) = [line for line in result.stderr.splitlines() if line.strip()]
    return line


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


def test_train_export_and_eval(edgemap, squares, tmp_path):
    data = f"yolo:{squares}"
    small = ("--data", data, "--validation", data, "--start", "none", "--input", "64", "--batch", "5", "-o", tmp_path)
    result = edgemap("train", "detector", *small, "--epochs", "1")
    assert result.returncode == 0, result.stderr
    assert "10 pictures with 10 boxes to train on, 10 to validate on" in result.stdout
    assert {path.name for path in tmp_path.iterdir()} >= {"best.pt", "last.pt", "curves.csv"}
    assert len((tmp_path / "curves.csv").read_text().splitlines()) >= 2
    result = edgemap("export", tmp_path / "best.pt", "-o", tmp_path / "bundle")
    assert result.returncode == 0, result.stderr
    assert "bundle edgemap-nano" in result.stdout
    flags = ("--bundle", tmp_path / "bundle", "--json")
    figures = json.loads(edgemap("eval", "detection", "--data", data, *flags).stdout)
    assert (figures["pictures"], figures["boxes_true"], figures["boxes_ignored"]) == (10, 9, 1)
    assert "the bundle knows person, cat" in one_line(
        edgemap("eval", "detection", "--data", data, *flags, "--classes", "sofa")
    )
    assert "is a detector itself" in one_line(
        edgemap("export", tmp_path / "best.pt", "--backbone", "yolov3", "-o", tmp_path / "x")
    )


@pytest.mark.parametrize(
    ("flags", "message"),
    [
        (("--input", "100"), "--input 100: must be a multiple of 32"),
        (("--minutes", "0"), "--minutes 0.0: must be above 0"),
        (("--start", "resnet"), "--start resnet: expected yolox-nano"),
        (("--start", "none", "--resume"), "last.pt: no such checkpoint"),
        (("--start", "none", "--weights", "none.pt"), "none.pt: no such checkpoint"),
    ],
)
def test_mistakes_are_one_line(edgemap_here, squares, tmp_path, flags, message):
    data = ("--data", f"yolo:{squares}", "--validation", f"yolo:{squares}")
    assert message in one_line(edgemap_here("train", "detector", *data, "-o", tmp_path, *flags))
