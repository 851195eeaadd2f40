"""Whole exports: contract, parity over a chain of steps, refusal that leaves nothing, an older bundle kept."""

import msgspec
import numpy as np
import onnxruntime as ort
import pytest
import torch

from edgemap.export import backbones, exporter, parity
from edgemap.export.darknet import Darknet
from edgemap.export.darknet_weights import load_weights
from edgemap.export.errors import ExportError
from edgemap.export.exporter import export_backbone
from edgemap.export.odometry.checkpoint import HeadCheckpoint, save_head
from edgemap.export.odometry.paper import PaperHead, random_head
from edgemap.runtime.frames.errors import BundleError
from edgemap.runtime.network.bundle import load_bundle
from edgemap.runtime.network.manifest_file import read_manifest, sha256_file, write_manifest
from edgemap.runtime.network.store import bundle_folder, install_folder


def test_manifest_of_a_small_network(small):
    manifest = read_manifest(small)
    detector, head = manifest.detector, manifest.odometry["paper"]
    stated = manifest.name, detector.decode, detector.input.resize, detector.input.pad
    assert stated == ("small", "yolov3", "stretch", 127)  # its cfg has the fork's scale_x_y
    assert (detector.input.colour, detector.input.scale, detector.input.width) == ("rgb", 1.0, 32)
    (only,) = detector.heads
    assert (only.shape, only.strides, only.anchors, only.scale_xy) == ((1, 7, 4, 4), (8,), ((10.0, 12.0),), 1.05)
    assert [(f.name, f.shape, f.stride) for f in detector.features] == [(only.name, (1, 7, 4, 4), 8)]
    assert [entry.name for entry in detector.classes] == ["class 0", "class 1"]
    parameters = sum(parameter.numel() for parameter in random_head((1, 7, 4, 4)).parameters())
    assert (head.feature, head.trained, head.parameters) == (only.name, False, parameters)
    assert set(manifest.sha256) == {"backbone.onnx", "odometry.paper.onnx"}
    assert manifest.measured["weights"]["float32_values"] == 659
    assert manifest.measured["weights"]["pictures_seen"] == 77
    for name, proof in manifest.parity.items():
        assert 0.0 < proof.max_abs_difference <= proof.tolerance, name
        assert (proof.steps, proof.cases) == (parity.STEPS, parity.CASES)
        assert proof.steps >= 8
    assert sorted(path.name for path in small.parent.iterdir()) == ["small"]


def test_backbone_takes_raw_pictures_and_equals_darknet_on_scaled_ones(small, small_cfg, small_weights):
    network = Darknet(small_cfg).eval()
    load_weights(network, small_weights)
    picture = np.random.default_rng(5).integers(0, 256, (1, 3, 32, 32)).astype(np.float32)
    with torch.no_grad():
        (expected,) = network(torch.from_numpy(picture / 255.0))
    session = ort.InferenceSession(small / "backbone.onnx", providers=["CPUExecutionProvider"])
    found = np.asarray(session.run(None, {"image": picture})[0])
    np.testing.assert_allclose(found, expected.numpy(), atol=1e-5 * np.abs(found).max())


def test_the_same_export_twice_gives_the_same_bytes(tmp_path, small, small_cfg, small_weights):
    again = export_backbone(str(small_cfg), tmp_path / "again", weights=small_weights, feature="head")
    assert read_manifest(again).sha256 == read_manifest(small).sha256


def test_failed_parity_refuses_and_leaves_nothing(tmp_path, small_cfg, small_weights, monkeypatch):
    """One weight of the exported graph is off by a part: the proof must see it."""
    true_export = backbones.backbone_to_onnx

    def wrong_export(network, detector):
        with torch.no_grad():
            network.convolutions()[2].conv.weight[0, 0, 0, 0] += 0.5
            model = true_export(network, detector)
            network.convolutions()[2].conv.weight[0, 0, 0, 0] -= 0.5
        return model

    monkeypatch.setattr(backbones, "backbone_to_onnx", wrong_export)
    out = tmp_path / "out" / "small"
    with pytest.raises(ExportError, match=r"backbone.onnx: parity failed: head_stride8 differs by .* tolerance"):
        export_backbone(str(small_cfg), out, weights=small_weights)
    assert list(out.parent.iterdir()) == []


@pytest.mark.usefixtures("traced_once")
def test_failed_parity_of_the_final_state_alone_is_seen(tmp_path, small_cfg, small_weights, monkeypatch):
    """The cell state of the last layer is wrong by 1 % in the graph; motion of the same step is right."""
    true_forward, tracing = PaperHead.forward, {"on": False}

    def forward(self, feature, *state):
        motion, *new = true_forward(self, feature, *state)
        if tracing["on"]:
            new[-1] = new[-1] * 1.01
        return motion, *new

    true_export = exporter.head_to_onnx

    def wrong_export(head, record):
        tracing["on"] = True
        try:
            return true_export(head, record)
        finally:
            tracing["on"] = False

    monkeypatch.setattr(PaperHead, "forward", forward)
    monkeypatch.setattr(exporter, "head_to_onnx", wrong_export)
    with pytest.raises(ExportError, match=r"odometry.paper.onnx: parity failed: cell2_out differs"):
        export_backbone(str(small_cfg), tmp_path / "out", weights=small_weights, feature="head")
    assert not (tmp_path / "out").exists()


@pytest.mark.usefixtures("traced_once")
def test_a_failed_export_keeps_the_bundle_and_a_good_one_replaces_it(small, small_cfg, small_weights, monkeypatch):
    before = sha256_file(small / "bundle.json")
    with monkeypatch.context() as patch:
        patch.setattr(parity, "RELATIVE_TOLERANCE", 0.0)
        with pytest.raises(ExportError, match="parity failed"):
            export_backbone(str(small_cfg), small, weights=small_weights)
    assert sha256_file(small / "bundle.json") == before
    export_backbone(str(small_cfg), small, weights=small_weights, feature="stride4")
    assert [f.stride for f in read_manifest(small).detector.features] == [4]
    assert sorted(path.name for path in small.parent.iterdir()) == ["small"]


def test_a_folder_that_is_no_bundle_is_left_alone(tmp_path, small_cfg, small_weights):
    (tmp_path / "photos").mkdir()
    (tmp_path / "photos" / "a.jpg").write_bytes(b"x")
    with pytest.raises(BundleError, match="exists and is no bundle"):
        export_backbone(str(small_cfg), tmp_path / "photos", weights=small_weights)
    assert (tmp_path / "photos" / "a.jpg").read_bytes() == b"x"


@pytest.mark.parametrize("field", ["anchors", "strides", "scale_xy"])
def test_a_manifest_that_differs_from_the_graphs_contract_is_refused(small, field):
    manifest = read_manifest(small)
    value = {"anchors": ((9.0, 12.0),), "strides": (16,), "scale_xy": 1.0}[field]
    head = msgspec.structs.replace(manifest.detector.heads[0], **{field: value})
    detector = msgspec.structs.replace(manifest.detector, heads=(head,))
    write_manifest(small, msgspec.structs.replace(manifest, detector=detector))
    with pytest.raises(BundleError, match=r"contract in its metadata differs|by its strides, anchors"):
        load_bundle(small)


@pytest.mark.usefixtures("traced_once")
def test_a_trained_head_brings_its_facts_along(tmp_path, small_cfg, small_weights):
    head = random_head((1, 8, 4, 4), seed=9)
    path = tmp_path / "best.pt"
    facts = HeadCheckpoint(head, str(small_cfg), "layer:3", sigma=(0.01, 0.02, 0.03))
    save_head(facts, path)
    manifest = read_manifest(export_backbone(str(small_cfg), tmp_path / "b", weights=small_weights, heads=[path]))
    record = manifest.odometry["paper"]
    assert (record.trained, record.feature, record.sigma_left_m) == (True, "feature_layer3", 0.02)
    with pytest.raises(ExportError, match="a trained head brings its own"):
        export_backbone(str(small_cfg), tmp_path / "c", weights=small_weights, heads=[path], feature="neck")
    with pytest.raises(ExportError, match="0 floor heads and 2 odometry heads, at most one of each"):
        export_backbone(str(small_cfg), tmp_path / "c", weights=small_weights, heads=[path, path])
    save_head(HeadCheckpoint(head, str(small_cfg), "head"), path)
    with pytest.raises(ExportError, match=r"takes features \(1, 8, 4, 4\), head_stride8 of small has \(1, 7, 4, 4\)"):
        export_backbone(str(small_cfg), tmp_path / "c", weights=small_weights, heads=[path])


@pytest.mark.usefixtures("traced_once")
def test_an_own_networks_bundle_has_its_folders_name_on_the_robot_too(tmp_path, small_cfg, small_weights, monkeypatch):
    monkeypatch.setenv("EDGEMAP_CACHE", str(tmp_path / "cache"))
    made = export_backbone(str(small_cfg), tmp_path / "my-bundle", weights=small_weights)
    installed = install_folder(made)
    assert installed == bundle_folder("my-bundle")
    assert read_manifest(installed).name == "my-bundle"
    odd = export_backbone(str(small_cfg), tmp_path / "mein Bündel", weights=small_weights)
    assert read_manifest(odd).name == "small"
