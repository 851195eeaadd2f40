"""Refusals of readers that no other test meets: each is reached, and says the number or name that is wrong."""

import json

import cv2
import numpy as np
import pytest
from support.refusal import refused

from edgemap.bridges.ros2.recordings.camera import RecordingCamera
from edgemap.bridges.ros2.recordings.reader import McapReading
from edgemap.runtime.frames import number_rows
from edgemap.runtime.frames.errors import BundleError, CameraError
from edgemap.runtime.inputs.cameras.pictures import VideoCamera
from edgemap.runtime.inputs.drives import open_drive
from edgemap.runtime.inputs.drives.pose_files import read_stamps
from edgemap.runtime.network.engines import open_onnxruntime
from edgemap.runtime.network.network import Compute
from edgemap.runtime.outputs import sightings_file
from edgemap.runtime.step import config

POSE = "1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1\n"
EUROC_CAMERA = (
    "T_BS: {data: [1.0, 0, 0, 0, 0, 1.0, 0, 0, 0, 0, 1.0, 0, 0, 0, 0, 1.0]}\n"
    "resolution: [64, 48]\nintrinsics: [FX, 60.0, 32.0, 24.0]\n"
)


def folder_of(tmp_path, files):
    """files: text by relative path; a name that ends with .png gets a picture."""
    for name, text in files.items():
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        if name.endswith(".png"):
            cv2.imwrite(str(path), np.zeros((48, 64, 3), np.uint8))
        else:
            path.write_text(text)
    return tmp_path


def euroc(stamp="1000000000", fx="60.0", truth="1000000000 0 0 0 0 0 0 1\n"):
    camera = EUROC_CAMERA.replace("FX", fx)
    return {f"image/{stamp}.png": "", "cam0.yaml": camera, "imu.csv": "1000000000,0,0,0,0,0,9.8\n", "truth.txt": truth}


@pytest.mark.parametrize(
    ("kind", "files", "words"),
    [
        ("c2w", {"a.png": "", "poses.txt": POSE, "K.txt": "1 2 3"}, "3 numbers, expected a 3x3 matrix"),
        ("c2w", {"a.png": "", "poses.txt": POSE, "K.txt": "60 0 x 0 60 24 0 0 1"}, "not numbers, expected a 3x3"),
        ("c2w", {"a.png": "", "poses.txt": POSE, "K.txt": "-60 0 32 0 60 24 0 0 1"}, "fx is -60"),
        ("euroc", euroc(stamp="first"), "named after its stamp in nanoseconds"),
        ("euroc", euroc(fx="-1.0"), "fx is -1"),
        ("euroc", euroc(truth="9000000000 0 0 0 0 0 0 1\n"), "no picture lies in it"),
        ("tum", {"rgb.txt": "# nothing\n"}, "no pictures listed in it"),
        ("tum", {"rgb.txt": "soon rgb/a.png\n"}, "expected `stamp file`"),
        ("tum", {"rgb.txt": "1.0 rgb/a\x1b.png\n"}, "expected `stamp file`"),
        ("yolo", {"images/a.png": ""}, "labels: no such folder"),
        ("yolo", {"images/a.png": "", "labels/b.txt": ""}, "no label file for any of the 1 pictures"),
        ("yolo", {"images/a.png": "", "labels/a.txt": "0.5 0.5 0.5 0.1 0.1\n"}, "class 0.5 is not a whole number"),
        ("drive", {"camera.yaml": "{width: 64, height: 48, fx: 60, fy: 60, cx: 32, cy: 24}"}, "neither images/ nor"),
    ],
)  # fmt: skip
def test_a_folder_that_cannot_be(tmp_path, kind, files, words):
    text = refused(CameraError, open_drive, f"{kind}:{folder_of(tmp_path, files)}")
    assert words in text
    assert text.isprintable()


def test_what_is_not_there(tmp_path):
    for attempt in (
        lambda: open_drive(f"drive:{tmp_path / 'none'}"),
        lambda: VideoCamera("none", tmp_path / "none.mp4"),
        lambda: McapReading(tmp_path / "none.mcap"),
        lambda: RecordingCamera(str(tmp_path / "none.mcap")),
    ):
        with pytest.raises(CameraError, match="no such f"):
            attempt()


def test_more_rows_than_are_read(tmp_path, monkeypatch):
    monkeypatch.setattr(number_rows, "ROW_LIMIT", 2)
    (tmp_path / "times.txt").write_text("1\n2\n3\n")
    with pytest.raises(CameraError, match="more than 2 rows"):
        read_stamps(tmp_path / "times.txt")
    monkeypatch.setattr(sightings_file, "SIGHTINGS_LIMIT", 1)
    (tmp_path / "sightings.jsonl").write_text('{"label":"chair","map_m":[0,0]}\n' * 2)
    with pytest.raises(sightings_file.MapError, match="more than 1 sightings"):
        sightings_file.read_sightings(tmp_path)


def test_a_tuned_number_beyond_all_sense(tmp_path):
    (tmp_path / "run.json").write_text(json.dumps({"config": {"floor": {"max_sigma_m": 1e15}}}))
    with pytest.raises(config.ConfigError, match="not a finite number"):
        config.load_config(tmp_path / "run.json")


def test_half_a_character_in_yaml(tmp_path):
    """Python's strings hold it, no file does, and what checks the values cannot encode it."""
    for text in ('{"config": {"floor": {"max_sigma_m": "\\ud800"}}}', '"\\udfff": 1'):
        (tmp_path / "a.yaml").write_text(text)
        with pytest.raises(config.ConfigError, match="half a character"):
            config.load_config(tmp_path / "a.yaml")


def test_a_network_that_fails_as_it_runs_is_the_bundles_failure(tmp_path):
    onnx = pytest.importorskip("onnx")
    helper = onnx.helper
    graph = helper.make_graph(
        [helper.make_node("Reshape", ["x", "shape"], ["y"])],
        "g",
        [
            helper.make_tensor_value_info("x", onnx.TensorProto.FLOAT, (1, 4)),
            helper.make_tensor_value_info("shape", onnx.TensorProto.INT64, (2,)),
        ],
        [helper.make_tensor_value_info("y", onnx.TensorProto.FLOAT, (None, None))],
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
    path = tmp_path / "a.onnx"
    onnx.save(model, path)
    network = open_onnxruntime(path, Compute(1))
    with pytest.raises(BundleError, match="the network fails as it runs") as caught:
        network.run({"x": np.zeros((1, 4), np.float32), "shape": np.array([3, 3])})
    assert str(caught.value).isprintable()
