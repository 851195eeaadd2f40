"""From pictures with floor labels to a bundle's figures, as a user types it."""

import json

import cv2
import numpy as np
import pytest

pytest.importorskip("torch")


@pytest.fixture(scope="module")
def carpets(tmp_path_factory):
    """Four pictures of a speckled carpet below a plain wall, at many heights."""
    folder = tmp_path_factory.mktemp("carpets")
    (folder / "images").mkdir()
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


@pytest.mark.slow
def test_train_export_and_eval(edgemap, carpets, tmp_path):
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
    assert plain is not None
    tint = drawn.astype(int) - plain
    assert tint[-40:, :, 1].mean() > 10  # the floor is green
    assert tint[:40, :, 0].mean() > tint[:40, :, 1].mean()  # the wall blue
