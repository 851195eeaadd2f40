"""Published weights, from their files to the figures that they are known for."""

import json
import os

import onnx
import pytest

from edgemap.export.adopt import find_tap, static_tensors
from edgemap.runtime.network.manifest_file import read_manifest

pytestmark = pytest.mark.skipif("EDGEMAP_INTEGRATION" not in os.environ, reason="real weights: make integration")
NAMES = ("yolov3-tiny", "yolox-nano")


@pytest.fixture(scope="module")
def real_bundles(shared_data, tmp_path_factory, edgemap):
    """yolov3-tiny and yolox-nano as `edgemap export` writes them from the real weights."""
    folder, weights = tmp_path_factory.mktemp("bundles"), shared_data / "weights"
    for name, file in zip(NAMES, ("yolov3-tiny.weights", "yolox_nano.onnx"), strict=True):
        edgemap.ok("export", "--backbone", name, "--weights", weights / file, "-o", folder / name)
    return folder


@pytest.mark.parametrize(("name", "expected"), zip(NAMES, (0.289, 0.508), strict=True))
def test_ap50_is_what_these_weights_are_known_for(edgemap, real_bundles, shared_data, name, expected):
    """Measured elsewhere on the same pictures; YOLOv3-tiny letterboxed."""
    flags = ("--bundle", real_bundles / name, "--json")
    figures = json.loads(edgemap("eval", "detection", "--data", f"yolo:{shared_data / 'coco128'}", *flags).stdout)
    assert figures["ap50"] == pytest.approx(expected, abs=0.015)
    assert figures["pictures"] == 128


def test_yolov3_tiny_with_its_real_weights(real_bundles):
    manifest = read_manifest(real_bundles / "yolov3-tiny")
    assert [head.shape for head in manifest.detector.heads] == [(1, 255, 13, 13), (1, 255, 26, 26)]
    assert manifest.measured["weights"]["float32_values"] == 8_858_734
    assert manifest.measured["weights"]["sha256"].startswith("dccea06f59b7")
    assert {entry.name for entry in manifest.detector.classes if not entry.mapped} >= {"person", "dog", "giraffe"}
    assert manifest.parity["backbone.onnx"].max_abs_difference < 1e-3
    assert manifest.odometry == {}


def test_yolox_nano(real_bundles, shared_data):
    manifest = read_manifest(real_bundles / "yolox-nano")
    assert manifest.detector.heads[0].shape == (1, 3549, 85)
    assert (manifest.detector.features, manifest.odometry) == ((), {})
    assert manifest.parity["backbone.onnx"].max_abs_difference == 0.0
    tensors = static_tensors(onnx.load(shared_data / "weights" / "yolox_nano.onnx"))
    found = [find_tap(tensors, stride, 416, 416) for stride in (8, 16, 32)]
    assert [(tensor.channels, tensor.height) for tensor in found] == [(64, 52), (128, 26), (256, 13)]
