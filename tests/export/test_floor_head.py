"""A floor head joined to a detector: what torch computes, and nothing else changed."""

import copy

import numpy as np
import onnx
import pytest
import torch

from edgemap.export.adopt import load_onnx
from edgemap.export.detector.network import load_detector
from edgemap.export.errors import ExportError
from edgemap.export.exporter import export_backbone
from edgemap.export.floor.checkpoint import FloorCheckpoint, is_floor, load_floor, save_floor
from edgemap.export.floor.features import Features
from edgemap.export.floor.head import FloorHead
from edgemap.export.floor.merge import floor_taps, with_floor, without_floor
from edgemap.runtime.network.bundle import load_bundle
from edgemap.runtime.network.decode import Detector
from edgemap.runtime.network.engines import open_onnxruntime
from edgemap.runtime.network.manifest_file import read_manifest
from edgemap.runtime.network.network import Compute
from edgemap.runtime.network.store import bundle_folder

SHIPPED = ["edgemap-pico", "edgemap-nano", "yolox-nano"]


def random_head(channels, seed=0, rows=26):
    """With statistics and weights that matter: an untrained one's normalisation does nothing."""
    torch.manual_seed(seed)
    head = FloorHead(channels, rows)
    for name, tensor in head.state_dict().items():
        if tensor.is_floating_point():
            tensor.copy_(torch.rand_like(tensor) + 0.5 if "var" in name else 0.3 * torch.randn_like(tensor))
    return head.eval()


def runs(model, picture):
    network = open_onnxruntime(model.SerializeToString(), Compute())
    (name,) = network.inputs
    return network.run({name: picture})


@pytest.mark.parametrize("name", SHIPPED)
def test_the_joined_output_is_torchs_and_all_others_stay_bit_for_bit(name):
    model, manifest = load_detector(name)
    taps = floor_taps(model, manifest.detector)
    assert [tap.height for tap in taps] == [104, 52, 26, 13]
    head = random_head(tuple(tap.channels for tap in taps))
    joined, detector = with_floor(model, manifest.detector, head, [tap.name for tap in taps])
    shown = copy.deepcopy(joined)
    known = {value.name for value in shown.graph.output}
    for tap in taps:
        if tap.name not in known:
            shape = (1, tap.channels, tap.height, tap.width)
            shown.graph.output.append(onnx.helper.make_tensor_value_info(tap.name, onnx.TensorProto.FLOAT, shape))
    picture = np.random.default_rng(1).standard_normal((1, 3, 416, 416)).astype(np.float32)
    before, after, features = runs(model, picture), runs(joined, picture), runs(shown, picture)
    assert list(after) == list(detector.outputs())
    assert set(after) - set(before) == {"floor"}
    for key, values in before.items():
        np.testing.assert_array_equal(after[key], values)
    with torch.no_grad():
        expected = head(*(torch.from_numpy(features[tap.name]) for tap in taps)).sigmoid().numpy()
    assert expected.std() > 0.05
    np.testing.assert_allclose(after["floor"], expected, atol=2e-5)
    bare, contract = without_floor(joined, detector)
    assert bare.graph.SerializeToString() == model.graph.SerializeToString()
    assert contract == manifest.detector


def test_a_head_that_knows_no_row_is_trained_on_the_rows_that_a_picture_reaches(tmp_path, brief):
    features = Features("edgemap-nano")
    head = random_head(tuple(tap.channels for tap in features.taps), rows=0)
    names = tuple(tap.name for tap in features.taps)
    save_floor(FloorCheckpoint(head, "edgemap-nano", names), tmp_path / "head.pt")  # type: ignore[arg-type]
    exported = export_backbone("edgemap-nano", tmp_path / "b", heads=[tmp_path / "head.pt"])
    assert read_manifest(exported).name == "b"  # not its backbone's, which the package has
    bundle = load_bundle(exported, 1).for_pictures(640, 480)
    assert bundle.detector.input.height == 320
    picture = np.random.default_rng(3).integers(0, 255, (480, 640, 3), np.uint8)
    outputs, _ = Detector(bundle).raw(picture)
    levels, placement, computed = features(picture)
    np.testing.assert_array_equal(computed[0], [1] * 10 + [0] * 3)
    with torch.no_grad():
        expected = head(*map(torch.from_numpy, [*levels, computed])).sigmoid().numpy()
    assert expected[:, :, :78].std() > 0.05
    np.testing.assert_allclose(outputs["floor"], expected[:, :, :80], atol=1e-4)
    assert (placement.width, placement.height) == (416, 312)


@pytest.mark.parametrize("name", ["edgemap-pico", "edgemap-nano"])
def test_what_ships_gives_the_boxes_of_the_network_without_its_floor_head(name):
    bundle = load_bundle(bundle_folder(name), 1)
    detector = bundle.manifest.detector
    assert detector.floor is not None
    bare, _ = without_floor(load_onnx(bundle.folder / detector.file), detector)
    picture = np.random.default_rng(2).standard_normal(bundle.backbone.inputs[detector.input.name]).astype(np.float32)
    network = open_onnxruntime(bare.SerializeToString(), Compute(), detector.input.height)
    expected, found = network.run({detector.input.name: picture}), bundle.backbone.run({detector.input.name: picture})
    assert set(found) - set(expected) == {detector.floor.name}
    for key, values in expected.items():
        np.testing.assert_array_equal(found[key], values)


def checkpoint(tmp_path, name="edgemap-pico", **changes):
    model, manifest = load_detector(name)
    taps = floor_taps(model, manifest.detector)
    head = random_head(tuple(tap.channels for tap in taps))
    names = tuple(tap.name for tap in taps)
    options = {"head": head, "backbone": name, "taps": names, "sources": ("labels by hand",)} | changes
    save_floor(FloorCheckpoint(**options), tmp_path / "best.pt")
    return tmp_path / "best.pt"


def test_export_joins_a_trained_head_and_says_where_it_came_from(tmp_path, brief):
    path = checkpoint(tmp_path)
    assert is_floor(path)
    out = export_backbone("edgemap-pico", tmp_path / "b", heads=[path])
    manifest = read_manifest(out)
    assert manifest.detector.floor is not None
    assert (manifest.detector.floor.labels, manifest.detector.floor.stride) == (("floor", "wall"), 4)
    assert "labels by hand" in manifest.sources
    assert manifest.measured["floor"]["parameters"] == load_floor(path).head.parameters_count
    assert 0.0 < manifest.parity["backbone.onnx"].max_abs_difference <= manifest.parity["backbone.onnx"].tolerance
    again = export_backbone("edgemap-pico", tmp_path / "c", heads=[path])
    assert (again / "backbone.onnx").read_bytes() == (out / "backbone.onnx").read_bytes()


def test_a_head_of_another_network_and_two_heads_are_refused(tmp_path):
    path = checkpoint(tmp_path)
    with pytest.raises(ExportError, match="it is of another network"):
        export_backbone("edgemap-nano", tmp_path / "b", heads=[path])
    with pytest.raises(ExportError, match="2 floor heads and 0 odometry heads, at most one of each"):
        export_backbone("edgemap-pico", tmp_path / "b", heads=[path, path])
    assert not (tmp_path / "b").exists()
