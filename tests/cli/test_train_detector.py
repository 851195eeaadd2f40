"""From labelled pictures to a bundle's figures, as a user types it."""

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

from edgemap.cli import main
from edgemap.export import parity

ROOT = Path(__file__).parents[2]


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


@pytest.mark.slow
def test_the_page_s_commands_train_a_bundle(flat):
    place, printed = flat
    assert "8 pictures with 4 boxes to train on, 3 to validate on" in printed
    assert {path.name for path in (place / "flat/trained").iterdir()} >= {"best.pt", "blended.pt", "last.pt"}
    assert len((place / "flat/trained/curves.csv").read_text().splitlines()) >= 2
    assert (place / "my-flat/backbone.onnx").is_file()


@pytest.mark.slow
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
    train = (
        "train",
        "detector",
        "--data",
        f"yolo:{squares}",
        "--validation",
        f"yolo:{squares}",
        "-o",
        tmp_path / "none",
    )
    assert "last.pt: no such checkpoint" in one_line(edgemap(*train, "--resume"))
