"""Real quantisation of a small network: what becomes 8-bit, what stays, what is reported, what is refused."""

import shutil

import cv2
import numpy as np
import onnx
import pytest
from onnx import numpy_helper
from support import painted

from edgemap.export.exporter import export_backbone
from edgemap.export.quantise import MAXIMUM_JUDGED, MAXIMUM_SHOWN, int8_report, read_calibration
from edgemap.runtime.frames.errors import CameraError
from edgemap.runtime.inputs.drives.pictures import read_picture
from edgemap.runtime.network.bundle import load_bundle
from edgemap.runtime.network.manifest_file import read_manifest

CHAIR, ELSEWHERE = ("chair", 40.0, 30.0, 20.0, 24.0, 0.9), ("chair", 12.0, 50.0, 20.0, 24.0, 0.9)


def write_pictures(folder, count=6, size=32):
    folder.mkdir(parents=True, exist_ok=True)
    random = np.random.default_rng(1)
    for index in range(count):
        blocks = random.integers(0, 256, (4, 4, 3), dtype=np.uint8)
        cv2.imwrite(str(folder / f"{index}.png"), cv2.resize(blocks, (size, size), interpolation=cv2.INTER_NEAREST))
    return folder


@pytest.fixture(scope="module")
def quantised_once(tmp_path_factory, small_files):
    folder, (cfg, weights) = tmp_path_factory.mktemp("quantised"), small_files
    options = {"weights": weights, "feature": "layer:2", "calibrate": write_pictures(folder / "pictures")}
    return export_backbone(str(cfg), folder / "b", **options)


@pytest.fixture
def quantised_bundle(tmp_path, quantised_once):
    """The small network with an odometry head on an inner feature, and its int8 variant; the test's own copy."""
    return shutil.copytree(quantised_once, tmp_path / "b")


def test_int8_is_near_float32_and_features_are_the_same_bit_for_bit(quantised_bundle, tmp_path):
    exact, small = load_bundle(quantised_bundle), load_bundle(quantised_bundle, precision="int8")
    assert (exact.precision, small.precision) == ("float32", "int8")
    pictures = write_pictures(tmp_path / "pictures")
    picture = read_picture(pictures / "3.png")[:, :, ::-1].transpose(2, 0, 1)[None].astype(np.float32)
    true, found = exact.backbone.run({"image": picture}), small.backbone.run({"image": picture})
    np.testing.assert_array_equal(found["feature_layer2"], true["feature_layer2"])
    gap = np.abs(found["head_stride8"] - true["head_stride8"])
    assert 0.0 < gap.max() < 0.1 * np.ptp(true["head_stride8"])


def test_what_is_8_bit_and_what_is_not(quantised_bundle):
    graph = onnx.load(quantised_bundle / "backbone.int8.onnx").graph
    constants = {item.name: numpy_helper.to_array(item) for item in graph.initializer}
    makers = {name: node for node in graph.node for name in node.output}
    convolutions = [node for node in graph.node if node.op_type == "Conv"]
    eight_bit = [node for node in convolutions if node.input[1] in makers]
    # Two of the four lead to the feature of layer 2, the last is the head's own.
    assert (len(convolutions), len(eight_bit)) == (4, 1)
    weight, scales = (constants[name] for name in makers[eight_bit[0].input[1]].input[:2])
    assert (weight.dtype, weight.shape, scales.shape) == (np.int8, (8, 2, 3, 3), (8,))
    assert np.abs(weight).max() == 127


def test_the_manifest_says_what_was_measured(quantised_bundle):
    manifest = read_manifest(quantised_bundle)
    assert set(manifest.sha256) == {"backbone.onnx", "backbone.int8.onnx", "odometry.paper.onnx"}
    variant = manifest.variants["int8"]
    figures = variant.measured
    assert (variant.file, figures["pictures_shown"], figures["pictures_judged"]) == ("backbone.int8.onnx", 3, 3)
    assert figures["difference"]["feature_layer2"]["largest"] == 0.0
    head = figures["difference"]["head_stride8"]
    assert 0.0 < head["mean"] < head["largest"]
    assert head["mean"] < 0.2 * head["mean_value"]
    assert figures["time"] > 0.0
    assert "ap50" not in figures  # no labels


def test_no_pictures_no_bundle(tmp_path, small_cfg, small_weights):
    (tmp_path / "empty").mkdir()
    with pytest.raises(CameraError, match=r"empty: no pictures in it"):
        export_backbone(str(small_cfg), tmp_path / "b", weights=small_weights, calibrate=tmp_path / "empty")
    assert not (tmp_path / "b").exists()


@pytest.mark.parametrize(("count", "shown", "judged"), [(1, 1, 1), (2, 1, 1), (7, 4, 3), (300, 64, 200)])
def test_pictures_are_judged_that_were_not_shown(tmp_path, count, shown, judged):
    found = read_calibration(write_pictures(tmp_path / "images", count, size=8).parent)
    assert (len(found.shown), len(found.judged)) == (shown, judged)
    assert (shown, judged) <= (MAXIMUM_SHOWN, MAXIMUM_JUDGED)
    apart = {path for path, _ in found.judged} - set(found.shown)
    assert len(apart) == (judged if count > 1 else 0)
    assert {int(path.stem) // 100 for path in found.shown} == set(range((count + 99) // 100))  # from all over


def test_the_report_by_hand(tmp_path):
    """One network sees the chair where it stands, the other elsewhere: AP50 1 and 0."""
    exact = load_bundle(painted.write_painted(tmp_path / "exact", [CHAIR]))
    other = load_bundle(painted.write_painted(tmp_path / "other", [ELSEWHERE]))
    write_pictures(tmp_path / "data" / "images", 4, painted.SIZE)
    (tmp_path / "data" / "labels").mkdir()
    _, x, y, w, h, _ = CHAIR
    line = " ".join(f"{value / painted.SIZE:.6f}" for value in (x, y, w, h))
    for index in range(4):
        (tmp_path / "data" / "labels" / f"{index}.txt").write_text(f"56 {line}\n")  # COCO's number of the chair
    report = int8_report(exact, other, read_calibration(tmp_path / "data"))
    assert report["ap50"] == {"float32": 1.0, "int8": 0.0}
    gap = np.abs(painted.head_with([ELSEWHERE]) - painted.head_with([CHAIR]))
    assert report["difference"]["head"]["largest"] == pytest.approx(gap.max(), rel=1e-3)
    assert report["difference"]["head"]["mean"] == pytest.approx(gap.mean(), rel=1e-3)
    mean = np.abs(painted.head_with([CHAIR])).mean()
    assert report["difference"]["head"]["mean_value"] == pytest.approx(mean, rel=1e-3)
