"""Adopting ONNX detectors: recognised by their outputs, tapped by name or shape, else refused; PicoDet's raw heads."""

from functools import partial

import numpy as np
import onnx
import onnxruntime as ort
import pytest
import torch
from onnx import TensorProto, helper, numpy_helper
from support.refusal import refused

from edgemap.export.adopt import adopt
from edgemap.export.detector.graph import Graph
from edgemap.export.errors import ExportError
from edgemap.export.exporter import export_backbone
from edgemap.export.floor.merge import without_floor
from edgemap.runtime.network.bundle import load_bundle
from edgemap.runtime.network.manifest_file import read_manifest
from edgemap.runtime.network.store import bundle_folder


def little_yolox(path, classes=3, size=64, opset=11, rows=None, batch=1, sides_px=0.0):
    """A graph of YOLOX's form: three strided Relu convolutions, each grid a few rows of the one output. sides_px: added
    to the boxes' sides, as of a graph that decodes them itself."""
    rng = np.random.default_rng(0)
    nodes, weights, parts, source, channels, scale = [], [], [], "images", 3, 1.0 / 255.0
    for stride, width in ((8, 6), (16, 10), (32, 12)):
        step = 8 if stride == 8 else 2
        square = [step, step]
        kernel = rng.standard_normal((width, channels, step, step), np.float32) * scale / step
        read = rng.standard_normal((5 + classes, width, 1, 1), np.float32)
        cells = (size // stride) ** 2
        weights += [
            numpy_helper.from_array(kernel.astype(np.float32), f"w{stride}"),
            numpy_helper.from_array(read, f"h{stride}"),
            numpy_helper.from_array(np.array([batch, 5 + classes, cells], np.int64), f"s{stride}"),
        ]
        nodes += [
            helper.make_node("Conv", [source, f"w{stride}"], [f"c{stride}"], strides=square, kernel_shape=square),
            helper.make_node("Relu", [f"c{stride}"], [f"feature{stride}"]),
            helper.make_node("Conv", [f"feature{stride}", f"h{stride}"], [f"p{stride}"]),
            helper.make_node("Reshape", [f"p{stride}", f"s{stride}"], [f"r{stride}"]),
        ]
        parts.append(f"r{stride}")
        source, channels, scale = f"feature{stride}", width, 1.0
    nodes.append(helper.make_node("Concat", parts, ["all"], axis=2))
    nodes.append(helper.make_node("Transpose", ["all"], ["raw"], perm=[0, 2, 1]))
    nodes.append(helper.make_node("Add", ["raw", "sides"], ["output"]))
    sides = np.array([0, 0, sides_px, sides_px] + [0] * (1 + classes), np.float32)
    weights.append(numpy_helper.from_array(sides, "sides"))
    total = rows or sum((size // stride) ** 2 for stride in (8, 16, 32))
    shapes = {"images": [batch, 3, size, size], "output": [batch, total, 5 + classes]}
    begin, end = ([helper.make_tensor_value_info(name, TensorProto.FLOAT, shape)] for name, shape in shapes.items())
    graph = helper.make_graph(nodes, "little", begin, end, weights)
    onnx.save(helper.make_model(graph, opset_imports=[helper.make_opsetid("", opset)], ir_version=6), path)
    return path


refusal = partial(refused, ExportError, adopt)


def test_tap_by_name_and_by_stride(tmp_path):
    path = little_yolox(tmp_path / "m.onnx")
    for feature, (width, cells) in {"stride32": (12, 2), "stride8": (6, 8), "c16": (10, 4)}.items():
        model, detector = adopt(path, feature)
        name = feature.replace("stride", "feature")
        assert [(f.name, f.shape) for f in detector.features] == [(name, (1, width, cells, cells))]
        assert [value.name for value in model.graph.output] == ["output", name]
    assert detector.heads[0].shape == (1, 84, 8)
    assert detector.heads[0].strides == (8, 16, 32)
    assert (detector.input.resize, detector.input.colour, detector.input.pad) == ("letterbox_topleft", "bgr", 114)


def test_the_adopted_bundle_gives_the_same_bits_and_the_tapped_tensor(tmp_path):
    path = little_yolox(tmp_path / "m.onnx")
    out = export_backbone(str(path), tmp_path / "bundle", feature="stride16")
    manifest = read_manifest(out)
    assert manifest.parity["backbone.onnx"].max_abs_difference == 0.0
    picture = np.random.default_rng(1).integers(0, 256, (1, 3, 64, 64)).astype(np.float32)
    found = load_bundle(out).backbone.run({"images": picture})
    session = ort.InferenceSession(path, providers=["CPUExecutionProvider"])
    theirs = np.asarray(session.run(None, {"images": picture})[0])
    np.testing.assert_array_equal(found["output"], theirs)
    # the tapped tensor is the one that its name says: its own 1x1 head gives the rows of stride 16
    weight = next(numpy_helper.to_array(w) for w in onnx.load(path).graph.initializer if w.name == "h16")
    rows = np.einsum("oc,chw->hwo", weight[:, :, 0, 0], found["feature16"][0]).reshape(16, 8)
    np.testing.assert_allclose(rows, theirs[0, 64:80], rtol=1e-4, atol=1e-5)


def test_boxes_that_the_graph_decodes_are_not_decoded_again(tmp_path):
    _, raw = adopt(little_yolox(tmp_path / "raw.onnx"))
    _, decoded = adopt(little_yolox(tmp_path / "decoded.onnx", sides_px=20.0))
    assert (raw.decode, raw.reading, decoded.decode) == ("yolox", None, "reading")
    assert decoded.reading.form == "cxcywh"


def test_what_is_no_detector_or_of_an_opset_that_the_runtime_does_not_read_is_refused(tmp_path):
    path = little_yolox(tmp_path / "m.onnx")
    assert "no tensor 'nix'" in refusal(path, "nix")
    assert "no feature tensor of stride 4" in refusal(path, "stride4")
    data = path.read_bytes()
    path.write_bytes(data[: len(data) // 2])
    assert "not a whole ONNX model" in refusal(path)
    path.write_bytes(b"")
    assert "not a whole ONNX model" in refusal(path)
    assert "cannot be read" in refusal(tmp_path / "none.onnx")
    assert "fit no known rule; yolox has one, (1, 84, 5 + classes)" in refusal(little_yolox(path, rows=85))
    assert "expected one input (1, 3, H, W)" in refusal(little_yolox(path, batch=2))
    text = refused(ExportError, export_backbone, str(little_yolox(path, opset=9)), tmp_path / "b")
    assert "ONNX opset 9, the runtime reads 11 to 23" in text


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
    session = ort.InferenceSession(model.SerializeToString(), providers=["CPUExecutionProvider"])
    ours = session.run(None, {"image": picture})
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
