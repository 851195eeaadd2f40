"""PicoDet's file becomes raw heads and fused hard-swish, with the numbers that it had."""

import numpy as np
import onnx
import onnxruntime as ort
import pytest

pytest.importorskip("torch")

import torch

from edgemap.export.adopt import adopt
from edgemap.export.detector.graph import Graph
from edgemap.export.floor.merge import without_floor
from edgemap.runtime.network.bundle import load_bundle
from edgemap.runtime.network.manifest_file import read_manifest
from edgemap.runtime.network.store import bundle_folder


@pytest.fixture(scope="module")
def file(shared_data):
    return shared_data / "weights" / "picodet_s_416.onnx"


def test_heads_are_scores_and_bins_of_the_file(file):
    model, detector = adopt(file)
    assert (detector.decode, detector.input.resize, len(detector.classes)) == ("dfl", "stretch", 80)
    assert [(head.strides, head.shape) for head in detector.heads] == [
        ((8,), (1, 112, 52, 52)), ((16,), (1, 112, 26, 26)), ((32,), (1, 112, 13, 13)), ((64,), (1, 112, 7, 7))
    ]  # fmt: skip
    kinds = [node.op_type for node in model.graph.node]
    assert kinds.count("HardSwish") == 87
    assert not {"Div", "Clip"} & set(kinds)
    picture = np.random.default_rng(0).standard_normal((1, 3, 416, 416)).astype(np.float32)
    whole = ort.InferenceSession(file, providers=["CPUExecutionProvider"]).run(None, {"image": picture})
    ours = ort.InferenceSession(model.SerializeToString(), providers=["CPUExecutionProvider"]).run(
        None, {"image": picture}
    )
    for head, scores, bins in zip(ours, whole[:4], whole[4:], strict=True):
        rows = np.asarray(head)[0].reshape(112, -1).T
        np.testing.assert_allclose(1.0 / (1.0 + np.exp(-rows[:, :80])), np.asarray(scores)[0], atol=1e-5)
        np.testing.assert_allclose(rows[:, 80:], np.asarray(bins)[0], atol=1e-3)


def test_the_shipped_bundle_is_fine_tuned_from_that_file(tmp_path, monkeypatch, file):
    """The first layers, up to stride 4, are the file's to the last bit; no other is."""
    monkeypatch.setenv("EDGEMAP_CACHE", str(tmp_path))
    folder = bundle_folder("edgemap-pico")
    manifest = read_manifest(folder)
    load_bundle(folder)
    model, detector = adopt(file)
    tuned_model, tuned_detector = without_floor(onnx.load(folder / "backbone.onnx"), manifest.detector)
    assert tuned_detector == detector
    start, tuned = Graph(model), Graph(tuned_model).state_dict()
    same = {name for name, value in start.state_dict().items() if torch.equal(value, tuned[name])}
    assert 0 < len(same) < 0.1 * len(tuned)
    photographs = (folder / "photographs.txt").read_text().split()
    assert len(set(photographs)) == len(photographs) == 2023  # whose licence wants them named
