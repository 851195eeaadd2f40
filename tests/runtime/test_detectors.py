"""What a picture becomes for a network, and its outputs for the step: boxes, and a mask of the floor; ONNX files of
other projects, whose layout is recognised."""

from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import onnx
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec.structs import replace
from onnx import TensorProto, helper, numpy_helper
from support import painted
from support.foreign_models import MODELS, SIDE, Graph, class_columns, write
from support.pictures import noise

from edgemap.geometry.camera.floor import FloorCamera
from edgemap.geometry.camera.intrinsics import Intrinsics
from edgemap.geometry.camera.mount import Mount
from edgemap.geometry.objects.visibility import iou
from edgemap.geometry.se2 import SE2
from edgemap.runtime.frames.class_names import read_class_names
from edgemap.runtime.frames.errors import BundleError
from edgemap.runtime.frames.frame import Frame
from edgemap.runtime.frames.trajectory import Trajectory
from edgemap.runtime.inputs.open import open_camera
from edgemap.runtime.motion.odometry.protocol import NO_PRIOR
from edgemap.runtime.motion.odometry.recorded import RecordedOdometry
from edgemap.runtime.network.bundle import load_bundle
from edgemap.runtime.network.decode import Decoder, Detector, suppress
from edgemap.runtime.network.foreign import ForeignFile, _manifest, probes, recognise
from edgemap.runtime.network.layouts import rows_of
from edgemap.runtime.network.manifest import DetectorSpec, FloorSpec, HeadSpec, InputSpec
from edgemap.runtime.network.network import Compute
from edgemap.runtime.network.open_bundle import open_bundle
from edgemap.runtime.network.preprocess import Placement, Preprocessor, floor_mask, place
from edgemap.runtime.network.store import bundle_folder
from edgemap.runtime.step.pipeline import Pipeline
from edgemap.runtime.step.slam import build_slam


def test_yolov3_head_decodes_to_what_was_painted():
    spec = painted.detector_spec()
    head = painted.head_with([("chair", 40.0, 30.0, 20.0, 24.0, 0.9), ("couch", 10.0, 50.0, 16.0, 12.0, 0.6)])
    found = Decoder(spec, 0.3)({"head": head}, place(spec.input, 128, 64))
    assert found.labels == ["chair", "couch"]
    assert found.scores == pytest.approx([0.9, 0.6], abs=1e-4)
    np.testing.assert_allclose(found.boxes, [[60, 18, 100, 42], [4, 44, 36, 56]], atol=1e-3)  # 128 wide: x doubled


def test_darknets_scale_x_y():
    spec = painted.detector_spec()
    spec = msgspec.structs.replace(spec, heads=(msgspec.structs.replace(spec.heads[0], scale_xy=1.2),))
    head = painted.head_with([("chair", 40.0, 30.0, 20.0, 24.0, 0.9)])
    box = Decoder(spec, 0.3)({"head": head}, place(spec.input, 64, 64)).boxes[0]
    x = (8 / 32 * 1.2 - 0.1 + 1) * 32  # cell 1, 8 of 32 px into it
    assert (box[0] + box[2]) / 2 == pytest.approx(x, abs=1e-3)


def spec_of(decode, shape, strides):
    """A detector of one head, its input and classes those of the painted one."""
    base = painted.detector_spec()
    heads = (HeadSpec(name="out", shape=shape, strides=strides),)
    return DetectorSpec(file="x.onnx", input=base.input, decode=decode, features=(), classes=base.classes, heads=heads)


def test_yolox_rows_by_hand():
    """One row of stride 8, one of stride 16, one of stride 32 in a 64x64 input: rows 0..63, 64..79, 80..83."""
    rows = np.zeros((1, 84, 5 + 3), dtype=np.float32)
    rows[0, 8 * 2 + 3] = [0.5, 0.25, np.log(2), np.log(3), 0.9, 0.1, 0.0, 0.8]  # column 3, row 2
    rows[0, 64 + 4 * 1 + 2] = [0.0, 0.5, np.log(1), np.log(1.5), 0.8, 0.9, 0.0, 0.0]  # column 2, row 1
    rows[0, 80 + 1] = [0.5, 0.5, np.log(0.5), np.log(1), 0.5, 0.0, 0.7, 0.0]  # column 1, row 0
    spec = spec_of("yolox", (1, 84, 8), (8, 16, 32))
    found = Decoder(spec, 0.3)({"out": rows}, place(spec.input, 64, 64))
    assert found.labels == ["couch", "chair", "person"]
    assert found.scores == pytest.approx([0.72, 0.72, 0.35])
    centres = (found.boxes[:, :2] + found.boxes[:, 2:]) / 2
    np.testing.assert_allclose(centres, [[28, 18], [32, 24], [48, 16]], atol=1e-4)
    np.testing.assert_allclose(found.boxes[0, 2:] - found.boxes[0, :2], [16, 24], atol=1e-4)


def test_dfl_bins_by_hand():
    """Two cells of a head of stride 8 in a 64x64 input: three classes, then eight bins for each of four sides."""
    head = np.full((1, 3 + 32, 8, 8), -20.0, dtype=np.float32)
    head[0, [1, 2], 2, 3] = [painted.logit(0.6), painted.logit(0.8)]  # row 2, column 3: its centre is (28, 20)
    sides = head[0, 3:, 2, 3].reshape(4, 8)
    sides[0, 1] = sides[1, 2] = sides[2, 3] = 20.0  # left 1 stride, top 2, right 3
    sides[3, [4, 5]] = 20.0  # bottom: halfway between 4 and 5
    head[0, 3:, 2, 3] = sides.ravel()
    head[0, 0, 7, 7] = painted.logit(0.29)  # too weak
    spec = spec_of("dfl", (1, 35, 8, 8), (8,))
    found = Decoder(spec, 0.3)({"out": head}, place(spec.input, 64, 64))
    assert found.class_ids.tolist() == [2]
    assert found.scores == pytest.approx([0.8], abs=1e-5)
    np.testing.assert_allclose(found.boxes, [[20, 4, 52, 56]], atol=1e-3)


def test_one_place_has_one_name_by_the_votes_of_its_cells():
    """Cells of a chair at 0.6 and 0.7 outvote a couch's one at 0.8; a couch elsewhere in the chair's box stays."""
    rows = np.zeros((1, 84, 8), dtype=np.float32)

    def put(cell, label, score, centre, side):
        column, row = cell % 8, cell // 8
        shift = [centre[0] / 8 - column, centre[1] / 8 - row]
        rows[0, cell] = [*shift, np.log(side / 8), np.log(side / 8), score, *(float(label == n) for n in range(3))]

    put(10, 0, 0.6, (20, 20), 24)
    put(11, 0, 0.7, (20, 20), 25)
    put(12, 1, 0.8, (20, 20), 24)
    put(40, 1, 0.5, (24, 24), 12)
    spec = spec_of("yolox", (1, 84, 8), (8, 16, 32))
    names = [entry.name for entry in spec.classes]
    both, one = (Decoder(spec, 0.3, one_name=flag)({"out": rows}, place(spec.input, 64, 64)) for flag in (False, True))
    assert both.labels == [names[1], names[0], names[1]]
    assert one.labels == [names[0], names[1]]
    assert one.scores == pytest.approx([0.7, 0.5])


def overlap(a, b):
    low, high = np.maximum(a[:2], b[:2]), np.minimum(a[2:], b[2:])
    shared = np.prod(np.clip(high - low, 0, None))
    return shared / (np.prod(a[2:] - a[:2]) + np.prod(b[2:] - b[:2]) - shared)


@settings(max_examples=40)
@given(st.integers(0, 10**6), st.integers(1, 60))
def test_suppression_is_greedy_and_class_wise(seed, count):
    rng = np.random.default_rng(seed)
    corners = rng.uniform(0, 60, (count, 2))
    boxes = np.concatenate([corners, corners + rng.uniform(5, 40, (count, 2))], axis=1)
    scores, classes = rng.permutation(np.linspace(0.1, 0.9, count)), rng.integers(0, 3, count)
    expected = []
    for i in np.argsort(-scores):
        if all(classes[i] != classes[j] or overlap(boxes[i], boxes[j]) <= 0.45 for j in expected):
            expected.append(i)
    assert suppress(boxes, scores, classes, 0.45).tolist() == expected


@settings(max_examples=40)
@given(
    st.integers(20, 900), st.integers(20, 900), st.sampled_from(["stretch", "letterbox", "letterbox_topleft"]),
    st.sampled_from([64, 416]),
)  # fmt: skip
def test_boxes_find_their_way_back_from_the_input(width, height, resize, size):
    spec = InputSpec(name="i", width=size, height=size, resize=resize, colour="rgb", scale=1.0)
    where = place(spec, width, height)
    whole = np.array([[where.left, where.top, where.left + where.width, where.top + where.height]], dtype=float)
    np.testing.assert_allclose(where.to_image(whole), [[0, 0, width, height]], atol=1e-9)


def test_the_tensor_holds_the_picture_in_its_place_and_colours():
    spec = InputSpec(name="i", width=8, height=8, resize="letterbox", colour="rgb", scale=1 / 255, pad=127)
    image = np.zeros((4, 8, 3), np.uint8)
    image[:, :, 0], image[:, :, 2] = 51, 255  # blue 0.2, red 1
    tensor, where = Preprocessor(spec)(image)
    assert (where.left, where.top, where.width, where.height) == (0, 2, 8, 4)
    np.testing.assert_allclose(tensor[0, :, 4, 4], [1.0, 0.0, 0.2], atol=1e-6)
    np.testing.assert_allclose(tensor[0, :, 0, 0], 127 / 255, atol=1e-6)


CHAIR = [("chair", 40.0, 30.0, 12.0, 24.0, 0.9)]
# 64x64 input, cells of 4 px: floor in the lower half, a wall in the upper one.
PAINTED = np.zeros((1, 2, 16, 16), np.float32)
PAINTED[0, 0, 8:], PAINTED[0, 1, :8] = 0.9, 0.8


class Remembering(RecordedOdometry):
    def step(self, frame, features, prior=NO_PRIOR):
        self.floor = prior.floor
        return super().step(frame, features, prior)


def observed(folder, width=64, height=64, frames=1):
    camera = FloorCamera(Intrinsics(width, height, 50.0, 50.0, width / 2, height / 2), Mount(1.0))
    odometry = Remembering(Trajectory(np.arange(9) / 10, (SE2(),) * 9), "test")
    pipeline = Pipeline(load_bundle(folder), camera, odometry)
    results: list[Any] = [pipeline.step(Frame(k, k / 10, noise(k, (height, width, 3)))) for k in range(frames)]
    return results[-1], odometry


def test_the_mask_reaches_observations_and_odometry(tmp_path):
    folder = painted.with_floor(painted.write_painted(tmp_path / "b", CHAIR), PAINTED, 4)
    result, odometry = observed(folder)
    assert result.floor is odometry.floor
    np.testing.assert_array_equal(result.floor.floor, PAINTED[0, 0])
    np.testing.assert_array_equal(result.floor.wall, PAINTED[0, 1])
    assert (result.floor.width, result.floor.height) == (64, 64)
    np.testing.assert_allclose(result.floor.at([[30.0, 20.0], [30.0, 50.0]]), [0.0, 0.9])
    assert list(result.stages_ms).index("floor_mask") == list(result.stages_ms).index("decode") + 1


@pytest.mark.parametrize(("resize", "rows"), [("letterbox_topleft", slice(0, 8)), ("letterbox", slice(4, 12))])
def test_letterbox_padding_is_cut_off(tmp_path, resize, rows):
    folder = painted.with_floor(painted.write_painted(tmp_path / "b", CHAIR, resize=resize), PAINTED, 4)
    result, _ = observed(folder, 128, 64)  # half the input's height
    np.testing.assert_array_equal(result.floor.floor, PAINTED[0, 0, rows])
    assert (result.floor.width, result.floor.height) == (128, 64)


def test_a_picture_that_ends_within_a_cell_keeps_its_geometry():
    # Rows of 4 px whose value is their middle's row: linear, so resampling must give the true row of each new middle.
    rows = np.arange(16, dtype=np.float32) * 4.0 + 2.0
    spec = FloorSpec(name="floor", shape=(1, 1, 16, 16), stride=4, labels=("floor",))
    tensors = {"floor": np.repeat(rows[:, None], 16, axis=1)[None, None]}
    mask = floor_mask(tensors, Placement(64, 43, 0, 10, 640, 430), spec)
    assert mask.floor.shape == (11, 16)  # 43 px are 10.75 cells
    expected = 10.0 + (np.arange(11) + 0.5) * 43.0 / 11.0
    np.testing.assert_allclose(mask.floor[:, 5], expected, atol=1e-4)


@pytest.fixture(scope="module")
def expected():
    """Boxes of the package's own reading of YOLOX-Nano, a list of each probe."""
    detector = Detector(load_bundle(bundle_folder("yolox-nano")))
    return [detector(probe.image) for probe in probes()]


def test_a_file_in_the_current_folder_is_not_taken_for_a_bundles_name(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert bundle_folder("detector.onnx") != Path("detector.onnx")
    Path("detector.onnx").touch()
    assert bundle_folder("detector.onnx") == Path("detector.onnx")


@pytest.mark.parametrize("name", MODELS)
def test_a_layout_is_recognised_and_gives_the_same_boxes(name, expected, tmp_path):
    file = ForeignFile(write(MODELS[name](Graph()), tmp_path / "a.onnx"), Compute(1))
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
    model = class_columns(Graph())
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
    kinds = [helper.np_dtype_to_tensor_dtype(value.dtype) for value in outputs.values()]
    shapes = zip(outputs, kinds, (value.shape for value in outputs.values()), strict=True)
    ends = [helper.make_tensor_value_info(*shape) for shape in shapes]
    begins = [helper.make_tensor_value_info(f"in{row}", TensorProto.FLOAT, shape) for row, shape in enumerate(inputs)]
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
    model = class_columns(Graph())
    model.metadata_props.add(key="task", value="classify")
    with pytest.raises(BundleError, match="classify"):
        recognise(ForeignFile(write(model, tmp_path / "a.onnx"), Compute(1)))


def test_random_weights_are_read_by_shape_where_nobody_checks(tmp_path):
    table = np.random.default_rng(0).uniform(0, 0.2, (1, 84, 200)).astype(np.float32)
    read = recognise(ForeignFile(made(tmp_path / "a.onnx", {"a": table}), Compute(1)), checked=False)
    assert read.reading.layout == "class columns"


AS_LIST, AS_TABLE = "names: [cone, ball]", "names:\n  0: cone\n  1: ball"


@pytest.mark.parametrize(("name", "text"), [("data.yaml", AS_LIST), ("data.yaml", AS_TABLE), ("a.txt", "cone\nball\n")])
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
    path = write(class_columns(Graph()), tmp_path / "other.onnx")
    alone, beside = load_bundle(bundle_folder("edgemap-nano")), open_bundle(path, "edgemap-nano", 1)
    with open_camera("demo") as camera:
        floor = FloorCamera(camera.info.intrinsics, camera.info.mount)
        slams = [build_slam(camera, bundle, floor) for bundle in (alone, beside)]
        frames = [frame for _ in range(12) if (frame := camera.read()) is not None]
    (*_, own), steps = ([slam.step(frame) for frame in frames] for slam in slams)
    foreign = steps[-1]
    assert own.pose_map_base == foreign.pose_map_base
    np.testing.assert_array_equal(own.observed.floor.floor, foreign.observed.floor.floor)
    assert "bed" in Detector(load_bundle(bundle_folder("yolox-nano")))(frames[-1].image).labels
    assert any("bed" in step.detections.labels for step in steps)  # at a camera's pace not every picture is searched
