"""ONNX files of other projects: the layout is recognised, the boxes are the detector's own, wrong files are refused."""

from pathlib import Path

import numpy as np
import onnx
import pytest
from msgspec.structs import replace
from onnx import TensorProto, helper, numpy_helper
from support.foreign_models import MODELS, SIDE, class_columns, write

from edgemap.geometry.camera.floor import FloorCamera
from edgemap.geometry.objects.visibility import iou
from edgemap.runtime.frames.class_names import read_class_names
from edgemap.runtime.frames.errors import BundleError
from edgemap.runtime.inputs.open import open_camera
from edgemap.runtime.network.bundle import load_bundle
from edgemap.runtime.network.decode import Decoder, Detector
from edgemap.runtime.network.foreign import ForeignFile, _manifest, probes, recognise
from edgemap.runtime.network.layouts import rows_of
from edgemap.runtime.network.network import Compute
from edgemap.runtime.network.open_bundle import open_bundle
from edgemap.runtime.network.preprocess import Placement, Preprocessor
from edgemap.runtime.network.store import bundle_folder
from edgemap.runtime.step.slam import build_slam


@pytest.fixture(scope="module")
def expected():
    """Boxes of the package's own reading of YOLOX-Nano, a list of each probe."""
    detector = Detector(load_bundle(bundle_folder("yolox-nano"), 1))
    return [detector(probe.image) for probe in probes()]


def test_a_file_in_the_current_folder_is_not_taken_for_a_bundles_name(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert bundle_folder("detector.onnx") != Path("detector.onnx")
    Path("detector.onnx").touch()
    assert bundle_folder("detector.onnx") == Path("detector.onnx")


@pytest.mark.parametrize("name", MODELS)
def test_a_layout_is_recognised_and_gives_the_same_boxes(name, expected, tmp_path):
    file = ForeignFile(write(MODELS[name](), tmp_path / "a.onnx"), Compute(1))
    read = recognise(file)
    assert read.input.colour == ("rgb" if name == "tensorflow" else "bgr")
    assert (read.input.scale, read.input.resize) == (1.0, "letterbox_topleft")
    preprocess = Preprocessor(read.input)
    for probe, own in zip(probes(), expected, strict=True):
        tensor, placement = preprocess(probe.image)
        corners, scores, labels = rows_of(file.run(tensor), read.reading, len(read.names), 0.3, (SIDE, SIDE))
        boxes, names = placement.to_image(corners), np.array([read.names[label] for label in labels])
        for box, score, label in zip(own.boxes, own.scores, own.labels, strict=True):
            same = names == label
            match = iou(box, boxes[same]) >= 0.99
            assert np.abs(scores[same][match] - score).min() < 1e-3


def test_metadata_of_ultralytics_states_names_and_size(tmp_path):
    model = class_columns()
    names = {number: f"piece {number}" for number in range(80)}
    for key, value in {"names": str(names), "stride": "32", "task": "detect", "imgsz": "[416, 416]"}.items():
        model.metadata_props.add(key=key, value=value)
    read = recognise(ForeignFile(write(model, tmp_path / "a.onnx"), Compute(1)))
    assert read.names[3] == "piece 3"
    assert (read.known, read.input.colour, read.input.resize) == (0, "rgb", "letterbox")


def made(path, outputs, inputs=((1, 3, 64, 64),)):
    """A model of constant outputs, by name."""
    values = [numpy_helper.from_array(value, f"{name}_value") for name, value in outputs.items()]
    nodes = [helper.make_node("Identity", [f"{name}_value"], [name]) for name in outputs]
    ends = [
        helper.make_tensor_value_info(name, helper.np_dtype_to_tensor_dtype(value.dtype), value.shape)
        for name, value in outputs.items()
    ]
    begins = [
        helper.make_tensor_value_info(f"in{number}", TensorProto.FLOAT, shape) for number, shape in enumerate(inputs)
    ]
    graph = helper.make_graph(nodes, "constant", begins, ends, values)
    onnx.save(helper.make_model(graph, opset_imports=[helper.make_opsetid("", 13)], ir_version=8), path)
    return path


def labelled(label):
    """Three boxes of one label."""
    boxes = np.array([[[5, 5, 20, 20], [30, 5, 60, 60], [1, 30, 20, 60]]], np.float32)
    return {"boxes": boxes, "scores": np.full((1, 3), 0.9, np.float32), "labels": np.full((1, 3), label, np.int64)}


def whole_picture():
    table = np.zeros((1, 84, 200), np.float32)
    table[0, :4], table[0, 4] = [[32], [32], [64], [64]], 0.9
    return table


@pytest.mark.parametrize(
    ("outputs", "inputs", "reason"),
    [
        ({"a": np.zeros((1, 1000), np.float32)}, ((1, 3, 64, 64),), r"\(1, 1000\)"),  # a classifier
        ({"a": np.zeros((1, 1, 64, 64), np.float32)}, ((1, 3, 64, 64),), r"\(1, 1, 64, 64\)"),  # depth
        ({"a": np.zeros((1, 84, 200), np.float32)}, ((1, 3, 64, 64), (1, 3, 64, 64)), "one input"),  # stereo
        ({"a": np.zeros((1, 16, 200), np.float32)}, ((1, 3, 64, 64),), "--names"),  # 12 classes without names
        ({"a": np.zeros((1, 84, 200), np.float32)}, ((1, 3, 64, 64),), "7 chairs"),  # detects nothing
        ({"a": whole_picture()}, ((1, 3, 64, 64),), "whole picture"),
        ({"a": np.zeros((1, 84, 200), np.float32)}, ((1, 3, 64, 60_000),), "width"),
        (labelled(364), ((1, 3, 64, 64),), "more classes than COCO has"),
    ],
)
def test_a_file_that_is_no_detector_is_refused_with_what_was_seen(outputs, inputs, reason, tmp_path):
    path = made(tmp_path / "a.onnx", outputs, inputs)
    with pytest.raises(BundleError, match=reason) as caught:
        recognise(ForeignFile(path, Compute(1)))
    assert "\n" not in str(caught.value)


def test_a_label_without_a_name_is_refused_when_it_comes_up(tmp_path):
    path = made(tmp_path / "a.onnx", labelled(7))
    manifest = _manifest(file := ForeignFile(path, Compute(1)), recognise(file, [*"abcdefgh"], checked=False))
    fewer = replace(manifest.detector, classes=manifest.detector.classes[:7])
    where = Placement(64, 64, 0, 0, 64, 64)
    outputs = file.run(np.zeros((1, 3, 64, 64), np.float32))
    assert Decoder(manifest.detector)(outputs, where).labels == ["h"] * 3
    with pytest.raises(BundleError, match=r"label 7, and the names are of 7 classes: .*--names"):
        Decoder(fewer)(outputs, where)


def test_a_task_other_than_detection_is_refused_by_its_name(tmp_path):
    model = class_columns()
    model.metadata_props.add(key="task", value="classify")
    with pytest.raises(BundleError, match="classify"):
        recognise(ForeignFile(write(model, tmp_path / "a.onnx"), Compute(1)))


def test_random_weights_are_read_by_shape_where_nobody_checks(tmp_path):
    table = np.random.default_rng(0).uniform(0, 0.2, (1, 84, 200)).astype(np.float32)
    read = recognise(ForeignFile(made(tmp_path / "a.onnx", {"a": table}), Compute(1)), checked=False)
    assert read.reading.layout == "class columns"


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("data.yaml", "names: [cone, ball]"),
        ("data.yaml", "names:\n  0: cone\n  1: ball"),
        ("names.txt", "cone\nball\n"),
    ],
)
def test_names_are_read_from_a_data_yaml_or_a_text_file(name, text, tmp_path):
    (tmp_path / name).write_text(text)
    assert read_class_names(tmp_path / name, BundleError) == ("cone", "ball")


@pytest.mark.parametrize("text", ["nc: 2", "names: {0: cone, 5: ball}", "names: [1, 2]", "names: [", "[1]"])
def test_a_data_yaml_without_names_is_refused_in_one_line(text, tmp_path):
    (tmp_path / "data.yaml").write_text(text)
    with pytest.raises(BundleError, match=r"data\.yaml") as caught:
        read_class_names(tmp_path / "data.yaml", BundleError)
    assert "\n" not in str(caught.value)


def test_motion_and_floor_come_from_a_companion(tmp_path):
    path = write(class_columns(), tmp_path / "other.onnx")
    alone, beside = load_bundle(bundle_folder("edgemap-nano"), 1), open_bundle(path, "edgemap-nano", 1)
    with open_camera("demo") as camera:
        assert camera.info.intrinsics is not None
        assert camera.info.mount is not None
        slams = [
            build_slam(camera, bundle, FloorCamera(camera.info.intrinsics, camera.info.mount))
            for bundle in (alone, beside)
        ]
        frames = [frame for _ in range(12) if (frame := camera.read()) is not None]
    (*_, own), steps = ([slam.step(frame) for frame in frames] for slam in slams)
    foreign = steps[-1]
    assert own.pose_map_base == foreign.pose_map_base
    np.testing.assert_array_equal(own.observed.floor.floor, foreign.observed.floor.floor)
    assert "bed" in Detector(load_bundle(bundle_folder("yolox-nano"), 1))(frames[-1].image).labels
    assert any("bed" in step.detections.labels for step in steps)  # at a camera's pace not every picture is searched
