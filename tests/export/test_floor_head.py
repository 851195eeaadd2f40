"""The floor head and its labels: joined without changing another output, trained on what pictures reach."""

import copy
import sys
from pathlib import Path
from types import SimpleNamespace

import cv2
import numpy as np
import onnx
import pytest
import torch

from edgemap.export.detector.network import load_detector
from edgemap.export.errors import ExportError
from edgemap.export.exporter import export_backbone
from edgemap.export.floor.checkpoint import FloorCheckpoint, save_floor
from edgemap.export.floor.features import Features
from edgemap.export.floor.head import FloorHead
from edgemap.export.floor.labels import open_teacher
from edgemap.export.floor.merge import floor_taps, with_floor, without_floor
from edgemap.export.floor.pictures import named, read_shares, targets, varied
from edgemap.runtime.frames.errors import CameraError
from edgemap.runtime.network.bundle import load_bundle
from edgemap.runtime.network.decode import Detector
from edgemap.runtime.network.engines import open_network
from edgemap.runtime.network.manifest_file import read_manifest
from edgemap.runtime.network.network import Compute
from edgemap.runtime.network.preprocess import Placement

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
    network = open_network(model.SerializeToString(), Compute())
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
    save_floor(FloorCheckpoint(head, "edgemap-nano", names), tmp_path / "head.pt")
    exported = export_backbone("edgemap-nano", tmp_path / "b", heads=[tmp_path / "head.pt"])
    assert read_manifest(exported).name == "b"  # not its backbone's, which the package has
    bundle = load_bundle(exported).for_pictures(640, 480)
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


def checkpoint(tmp_path, name="edgemap-pico", **changes):
    model, manifest = load_detector(name)
    taps = floor_taps(model, manifest.detector)
    head = random_head(tuple(tap.channels for tap in taps))
    names = tuple(tap.name for tap in taps)
    options = {"head": head, "backbone": name, "taps": names, "sources": ("labels by hand",)} | changes
    save_floor(FloorCheckpoint(**options), tmp_path / "best.pt")
    return tmp_path / "best.pt"


def test_a_head_of_another_network_and_two_heads_are_refused(tmp_path):
    path = checkpoint(tmp_path)
    with pytest.raises(ExportError, match="it is of another network"):
        export_backbone("edgemap-nano", tmp_path / "b", heads=[path])
    with pytest.raises(ExportError, match="2 floor heads and 0 odometry heads, at most one of each"):
        export_backbone("edgemap-pico", tmp_path / "b", heads=[path, path])
    assert not (tmp_path / "b").exists()


OTHER, FLOOR, WALL, UNKNOWN = (255, 0, 0), (0, 255, 0), (0, 0, 255), (0, 0, 0)


def test_label_files_of_one_channel_are_whole_shares_and_of_three_are_scaled_to_the_picture(tmp_path):
    cv2.imwrite(str(tmp_path / "hard.png"), np.array([[0, 1], [2, 255]], np.uint8))
    expected = np.array([[OTHER, FLOOR], [WALL, UNKNOWN]], np.uint8)
    np.testing.assert_array_equal(read_shares(tmp_path / "hard.png", (2, 2)), expected)
    cv2.imwrite(str(tmp_path / "soft.png"), np.full((4, 4, 3), (100, 130, 25), np.uint8))
    np.testing.assert_array_equal(read_shares(tmp_path / "soft.png", (6, 5)), np.full((5, 6, 3), (100, 130, 25)))
    with pytest.raises(CameraError, match="2x2 px, its picture has 3x2"):
        read_shares(tmp_path / "hard.png", (3, 2))


def test_labels_and_targets_are_shares_of_each_cells_labelled_part():
    shares = np.array([[(50, 200, 5), (120, 130, 5), (10, 20, 225), UNKNOWN]], np.uint8)
    np.testing.assert_array_equal(named(shares), [[1, 255, 2, 255]])
    shares = np.array([[FLOOR, FLOOR, OTHER, UNKNOWN], [FLOOR, WALL, UNKNOWN, UNKNOWN]], np.uint8)
    shares = np.concatenate([shares, np.full((2, 4, 3), (51, 204, 0), np.uint8)])
    parts, labelled = targets(shares, Placement(4, 4, 0, 0, 4, 4), 2, (2, 3))
    np.testing.assert_allclose(labelled, [[1.0, 0.25, 0.0], [1.0, 1.0, 0.0]], atol=1e-6)
    np.testing.assert_allclose(parts[0], [[0.75, 0.0, 0.0], [0.8, 0.8, 0.0]], atol=1e-6)
    np.testing.assert_allclose(parts[1], [[0.25, 0.0, 0.0], [0.0, 0.0, 0.0]], atol=1e-6)


def test_views_are_cut_and_mirrored_with_their_shares():
    shares = np.zeros((60, 80, 3), np.uint8)
    shares[:, :40, 0] = shares[:, 40:, 1] = 255
    picture = np.repeat(255 - shares[..., :1], 3, axis=2)  # white on the right, where the floor is
    agree = []
    for seed in range(30):
        view, kept = varied(picture, shares, np.random.default_rng(seed))
        assert view.shape == kept.shape
        bright = view.mean(axis=2)
        floor = kept[..., 1] > 0
        if 0.1 < floor.mean() < 0.9:
            agree.append(bright[floor].mean() > bright[~floor].mean())
    assert len(agree) > 15
    assert np.mean(agree) > 0.8  # a floor may be dyed darker


class LeftToRight:
    """Stands for the teacher's network: what is bright is floor, the more the farther right it lies."""

    def __init__(self, path, num_threads):
        pass

    def allocate_tensors(self):
        pass

    def get_input_details(self):
        return [{"index": 0, "shape": np.array([1, 8, 8, 3]), "dtype": np.uint8}]

    def get_output_details(self):
        return [{"index": 1, "shape": np.array([1, 8, 8, 32]), "quantization": (0.125, 10)}]

    def set_tensor(self, index, value):
        self.picture = value

    def invoke(self):
        self.logits = np.full((1, 8, 8, 32), 10, np.uint8)
        self.logits[..., 0] = 58  # 6 after scaling: other
        self.logits[0, :, :, 4] = np.where(self.picture[0, :, :, 0] > 128, 50 + 4 * np.arange(8), 10)

    def get_tensor(self, index):
        return self.logits


class LowestRows(LeftToRight):
    """Takes the lowest quarter of any picture for floor."""

    def invoke(self):
        self.logits = np.full((1, 8, 8, 32), 10, np.uint8)
        self.logits[..., 0] = 58
        self.logits[:, 6:, :, 4] = 90


def taught(monkeypatch, network, picture):
    monkeypatch.setitem(sys.modules, "ai_edge_litert", SimpleNamespace())
    monkeypatch.setitem(sys.modules, "ai_edge_litert.interpreter", SimpleNamespace(Interpreter=network))
    return open_teacher(Path("any.tflite"))(picture)


def test_the_teacher_sees_a_picture_and_its_mirror_image(monkeypatch):
    picture = np.zeros((80, 80, 3), np.uint8)
    picture[40:] = 255
    shares = taught(monkeypatch, LeftToRight, picture)
    np.testing.assert_array_equal(shares, taught(monkeypatch, LeftToRight, picture[:, ::-1])[:, ::-1])
    # Row 5 is white at each size; its column 2 lies between columns 2 and 3 of the teacher's output, see `at`.
    odds = [np.exp((40 + 4 * column) / 8.0 - 6.0) for column in range(8)]  # of floor against other
    means = [np.mean([odds[c] / (odds[c] + 1.0 + 30.0 * np.exp(-6.0)) for c in pair]) for pair in ((2, 5), (3, 4))]
    at = np.array([0.0, 0.375, 0.75])  # at the sizes 1, 0.7 (6 of 8 columns) and 0.5 (4 of 8)
    mean = (means[0] + at * (means[1] - means[0])).mean()
    floor = 1.0 / (1.0 + ((1.0 - mean) / mean * np.exp(-1.0)) ** 2)
    assert shares[5, 2, 1] == pytest.approx(255.0 * floor * (2.0 * floor - 1.0), abs=1.0)
    assert (named(shares[:4]) == 0).all()
    assert (named(shares[5:]) == 1).all()


def test_a_teacher_for_whom_low_is_floor_is_unsure_of_a_pictures_lower_border(monkeypatch):
    known = taught(monkeypatch, LowestRows, np.zeros((80, 80, 3), np.uint8)).sum(axis=2)
    assert (known[:4] > 240).all()
    assert (known[6:] < 240).all()
