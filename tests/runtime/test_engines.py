"""Networks: engines with the same outputs on the threads that were chosen, pictures that are searched beside the drive,
and files cut to the rows that pictures reach."""

import importlib.util
import json
import subprocess
import sys
import threading
from dataclasses import replace

import cv2
import msgspec
import numpy as np
import onnx
import onnxruntime as ort
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support import painted
from support.painted import FLOOR, slam_of
from support.pictures import noise

from edgemap.cli.network_options import NetworkOptions
from edgemap.geometry.se2 import SE2
from edgemap.runtime.frames.camera import CameraOptions
from edgemap.runtime.frames.errors import BundleError
from edgemap.runtime.frames.frame import Frame
from edgemap.runtime.frames.inference import Inference
from edgemap.runtime.inputs.open import open_camera
from edgemap.runtime.network.bundle import ENGINE_TOLERANCE, load_bundle
from edgemap.runtime.network.decode import Decoder, Detector
from edgemap.runtime.network.engines import compute_at, open_network
from edgemap.runtime.network.manifest import InputSpec
from edgemap.runtime.network.network import Compute
from edgemap.runtime.network.open_bundle import subgraph
from edgemap.runtime.network.preprocess import EDGE_PX, place, rows_of
from edgemap.runtime.network.store import bundle_folder
from edgemap.runtime.outputs.sinks.run_folder import RunFolder
from edgemap.runtime.step.loop import steps

NANO = bundle_folder("edgemap-nano")


def test_openvino_gives_onnxruntimes_outputs_and_keeps_them():
    pytest.importorskip("openvino")
    theirs, ours = load_bundle(NANO, Compute(engine="openvino")), load_bundle(NANO)
    assert (theirs.compute.engine, theirs.backbone.outputs) == ("openvino", ours.backbone.outputs)
    picture = np.random.default_rng(1).uniform(0, 255, (1, 3, 416, 416)).astype(np.float32)
    expected, found = ours.backbone.run({"image": picture}), theirs.backbone.run({"image": picture})
    theirs.backbone.run({"image": picture * 0})
    for name, value in expected.items():
        np.testing.assert_allclose(found[name], value, atol=2e-4 * np.abs(value).max())


INTERRUPTED = """
import gc, os, signal
from pathlib import Path
from edgemap.runtime.network.bundle import Compute, load_bundle

signal.signal(signal.SIGINT, lambda *_: print("handled", flush=True))
first, second = (load_bundle(Path({folder!r}), Compute(engine="openvino")) for _ in range(2))
del first
gc.collect()
del second
gc.collect()
os.kill(os.getpid(), signal.SIGINT)
"""


@pytest.mark.parametrize("options", [[], ["-X", "faulthandler"]], ids=["plain", "faulthandler"])
def test_ctrl_c_after_a_released_openvino_network_is_handled(options):
    """Two of its cores leave a signal stack that is unmapped once both are released."""
    pytest.importorskip("openvino")
    command = [sys.executable, *options, "-c", INTERRUPTED.format(folder=str(NANO))]
    ended = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (ended.returncode, ended.stdout) == (0, "handled\n"), ended.stderr


def test_a_replay_takes_the_recorded_engine_unless_another_is_asked_for(monkeypatch, capsys):
    recorded = Inference("openvino", "int8")
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: object())
    assert NetworkOptions().inference(recorded) == recorded
    assert NetworkOptions(precision="float32", engine="onnxruntime").inference(recorded) == Inference()
    assert NetworkOptions().inference() == Inference("onnxruntime", "float32")
    assert not capsys.readouterr().err
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    assert NetworkOptions().inference(recorded) == Inference("onnxruntime", "int8")
    assert "recorded with openvino, which is not installed" in capsys.readouterr().err


def test_an_engine_that_disagrees_is_refused(monkeypatch):
    pytest.importorskip("openvino")
    monkeypatch.setitem(ENGINE_TOLERANCE, "float32", 0.0)
    with pytest.raises(BundleError, match=r"backbone\.onnx: openvino gives other outputs than onnxruntime"):
        load_bundle(NANO, Compute(engine="openvino"))


SLEEPING, SPINNING = Compute(2), Compute(2, spin=True)


@pytest.mark.parametrize(
    ("pace", "cores", "threads", "expected"),
    [
        ("camera", 4, None, Compute(1)),
        ("camera", 4, 2, SLEEPING),
        ("files", 4, None, SPINNING),
        ("files", 1, None, Compute(1)),
        ("files", 4, 1, Compute(1)),
    ],
)
def test_threads_follow_the_pace_unless_they_are_stated(monkeypatch, pace, cores, threads, expected):
    monkeypatch.setattr("edgemap.runtime.network.engines._cores", lambda: cores)
    assert compute_at(pace, threads) == expected


def test_threads_change_no_bit_of_the_outputs():
    path, random = NANO / "backbone.onnx", np.random.default_rng(0)
    networks = [open_network(path, compute, 416) for compute in (Compute(1), SLEEPING, SPINNING)]
    tensors = {key: random.uniform(0, 1, shape).astype(np.float32) for key, shape in networks[0].inputs.items()}
    expected, *others = [network.run(tensors) for network in networks]
    for found in others:
        for key, value in expected.items():
            np.testing.assert_array_equal(found[key], value)


def test_blas_computes_on_one_thread_once_a_bundle_is_loaded():
    from threadpoolctl import threadpool_info

    load_bundle(NANO)
    assert {pool["num_threads"] for pool in threadpool_info() if pool["user_api"] == "blas"} == {1}


def test_a_network_that_fails_as_it_runs_is_the_bundles_failure(tmp_path):
    helper, kinds = onnx.helper, onnx.TensorProto
    values = (("x", kinds.FLOAT, (1, 4)), ("shape", kinds.INT64, (2,)), ("y", kinds.FLOAT, (None, None)))
    *given, made = (helper.make_tensor_value_info(*value) for value in values)
    graph = helper.make_graph([helper.make_node("Reshape", ["x", "shape"], ["y"])], "g", given, [made])
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
    path = tmp_path / "a.onnx"
    onnx.save(model, path)
    network = open_network(path, Compute(1))
    with pytest.raises(BundleError, match="the network fails as it runs") as caught:
        network.run({"x": np.zeros((1, 4), np.float32), "shape": np.array([3, 3])})
    assert str(caught.value).isprintable()


POSES = tuple(SE2(0.3 * index, 0.05 * index, 0.1 * index) for index in range(9))


@pytest.fixture(scope="module")
def bundle(tmp_path_factory):
    scene = [("chair", 40.0, 30.0, 12.0, 24.0, 0.9)]
    return load_bundle(painted.write_painted(tmp_path_factory.mktemp("bundles") / "b", scene))


def frame(index, search=True):
    return Frame(index, index / 10, noise(index), search=search)


@pytest.mark.parametrize("every", [1, 3])
def test_boxes_are_placed_by_the_pose_of_their_picture(bundle, every):
    alone, beside = slam_of(bundle, POSES), slam_of(replace(bundle, companion=bundle), POSES)
    expected = {}
    for index in range(9):
        result = alone.step(frame(index, index % every == 0))
        expected[index] = [placed.position_map_m for placed in result.sightings]
        late = beside.step(frame(index, index % every == 0))
        assert late.observed.searched == (index >= every and index % every == 0)
        if late.observed.searched:
            assert late.pictured.index == index - every
            assert [placed.sighting.frame for placed in late.sightings] == [index - every]
            np.testing.assert_allclose([one.position_map_m for one in late.sightings], expected[index - every])
    np.testing.assert_allclose(late.pose_map_base.vector(), result.pose_map_base.vector())
    late = beside.finish()
    newest = max(expected) // every * every
    assert [placed.sighting.frame for placed in late.sightings] == [newest]
    np.testing.assert_allclose([one.position_map_m for one in late.sightings], expected[newest])
    assert (late.frame.index, late.pictured.index) == (8, newest)
    assert beside.finish() is alone.finish() is None


def test_a_run_writes_the_boxes_of_the_last_picture_too(bundle, tmp_path):
    written = {}
    for index in range(9):
        cv2.imwrite(str(tmp_path / f"{index}.png"), noise(index))
    for name, one in {"alone": bundle, "beside": replace(bundle, companion=bundle)}.items():
        camera = open_camera(str(tmp_path), CameraOptions(FLOOR.intrinsics))
        slam = slam_of(one, POSES)
        assert len(list(steps(camera, slam, [RunFolder(tmp_path / name, FLOOR, {})]))) == 9
        lines = (tmp_path / name / "sightings.jsonl").read_text().splitlines()
        frames = len((tmp_path / name / "trajectory.tum").read_text().splitlines())
        written[name] = [(json.loads(line)["frame"], json.loads(line)["map_m"]) for line in lines], frames
    assert [frame for frame, _ in written["alone"][0]] == list(range(9))
    assert written["alone"] == written["beside"]


def test_at_a_cameras_pace_no_step_waits_and_a_replay_of_its_marks_gives_the_same(bundle):
    gate = threading.Event()
    network = replace(bundle.backbone, infer=lambda tensors: gate.wait(10.0) and bundle.backbone.infer(tensors))
    live = slam_of(replace(bundle, backbone=network, companion=bundle, paced=True), POSES)
    results = [live.step(frame(index)) for index in range(4)]  # returns, as nothing waits for the gate
    assert [result.frame.search for result in results] == [True, False, False, False]
    gate.set()
    while live.pipeline.marked(frame(4)).search is False:
        pass
    results.append(live.step(frame(4)))
    assert results[-1].pictured.index == 0
    replay = slam_of(replace(bundle, companion=bundle), POSES)
    for result in results:
        again = replay.step(result.frame)
        places = [[one.position_map_m.tolist() for one in step.sightings] for step in (again, result)]
        assert places[0] == places[1]


ENGINES = ["onnxruntime", "openvino"]


@pytest.fixture(scope="module")
def pictures():
    with open_camera("demo") as camera:
        frames = [frame for _ in range(12) if (frame := camera.read()) is not None]
    return [frame.image for frame in frames[::4]]


@pytest.mark.parametrize("engine", ENGINES)
def test_boxes_are_those_of_the_whole_input(pictures, engine):
    pytest.importorskip(engine)
    whole = load_bundle(NANO, Compute(engine=engine))
    cut = whole.for_pictures(640, 480)
    assert (whole.detector.input.height, cut.detector.input.height) == (416, 320)
    found = {}
    for bundle in (whole, cut):
        detector, decode = Detector(bundle), Decoder(bundle.detector, 0.3, one_name=True)
        for index, picture in enumerate(pictures):
            outputs, placement = detector.raw(picture)
            found[bundle is cut, index] = decode(outputs, placement)
    for index in range(len(pictures)):
        boxes, own_boxes = found[False, index], found[True, index]
        assert len(boxes) > 0
        assert list(own_boxes.labels) == list(boxes.labels)
        np.testing.assert_allclose(own_boxes.scores, boxes.scores, atol=0.02)
        assert np.median(np.abs(own_boxes.boxes - boxes.boxes)) < 0.5


@pytest.mark.parametrize(("w", "h", "rows"), [(640, 480, 320), (1280, 720, 256), (480, 640, 416), (416, 416, 416)])
def test_rows_follow_the_shape_of_the_pictures(w, h, rows):
    bundle = load_bundle(NANO).for_pictures(w, h)
    assert bundle.backbone.inputs["image"] == (1, 3, rows, 416)


@pytest.mark.parametrize("name", ["yolox-nano", "edgemap-pico"])
def test_a_file_of_fixed_size_is_left_as_it_is(name):
    bundle = load_bundle(bundle_folder(name))
    assert bundle.for_pictures(640, 480).backbone.inputs == bundle.backbone.inputs


@given(st.integers(40, 4000), st.integers(40, 4000), st.sampled_from(["stretch", "letterbox", "letterbox_topleft"]))
def test_a_cut_input_holds_the_whole_picture_where_it_was(width, height, resize):
    whole = InputSpec(name="image", width=416, height=416, resize=resize, colour="rgb", scale=1.0)
    first, rows = rows_of(whole, width, height, 32)
    cut = msgspec.structs.replace(whole, height=rows)
    before, after = place(whole, width, height), place(cut, width, height)
    assert (first % 32, rows % 32) == (0, 0)
    assert (after.width, after.height, after.left) == (before.width, before.height, before.left)
    assert after.top == before.top - first
    assert after.top >= 0
    assert after.top + after.height <= rows
    assert min(before.top + before.height + EDGE_PX, 416) <= first + rows  # the edge's features see the padding


def test_outputs_are_those_of_the_whole_file_and_the_rest_is_gone():
    whole = (bundle_folder("edgemap-pico") / "backbone.onnx").read_bytes()
    names = ["floor"]
    cut = subgraph(whole, set(names))
    onnx.checker.check_model(onnx.load_from_string(cut))
    assert len(cut) < 0.7 * len(whole)
    picture = np.random.default_rng(0).uniform(0, 1, (1, 3, 416, 416)).astype(np.float32)
    expected, given = (ort.InferenceSession(model).run(names, {"image": picture}) for model in (whole, cut))
    for one, other in zip(expected, given, strict=True):
        np.testing.assert_array_equal(one, other)
