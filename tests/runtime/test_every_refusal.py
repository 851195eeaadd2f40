"""Refusals of readers that no other test meets: each is reached, and says the number or name that is wrong."""

import io
import json
import os
import tracemalloc
import zipfile
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from support import painted
from support.huge_png import png
from support.refusal import refused

from edgemap.bridges.ros2.recordings.camera import RecordingCamera
from edgemap.bridges.ros2.recordings.reader import McapReading
from edgemap.calibrate.stated_focal import stated_focal_px
from edgemap.geometry.errors import MapError
from edgemap.runtime.frames.errors import BundleError, CameraError
from edgemap.runtime.frames.reading import one_line, read_bytes
from edgemap.runtime.inputs.cameras.pictures import VideoCamera
from edgemap.runtime.inputs.drives import open_drive
from edgemap.runtime.inputs.drives.pictures import list_pictures, read_picture
from edgemap.runtime.inputs.drives.sensor_csv import read_wheel_csv
from edgemap.runtime.network.engines import open_onnxruntime
from edgemap.runtime.network.manifest_file import read_manifest
from edgemap.runtime.network.network import Compute
from edgemap.runtime.network.store import install_folder
from edgemap.runtime.outputs import sightings_file
from edgemap.runtime.step.grid_file import load_grid, read_grid

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
        ("tum", {"rgb.txt": "# nothing\n"}, "nothing is listed in it"),
        ("tum", {"rgb.txt": "soon rgb/a.png\n"}, "expected 1 finite numbers a line, stamp_s"),
        ("tum", {"rgb.txt": "1.0 rgb/a\x1b.png\n"}, "expected 1 finite numbers a line, stamp_s"),
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


def test_a_network_that_fails_as_it_runs_is_the_bundles_failure(tmp_path):
    onnx = pytest.importorskip("onnx")
    helper = onnx.helper
    kinds = onnx.TensorProto
    values = (("x", kinds.FLOAT, (1, 4)), ("shape", kinds.INT64, (2,)), ("y", kinds.FLOAT, (None, None)))
    *given, made = (helper.make_tensor_value_info(*value) for value in values)
    graph = helper.make_graph([helper.make_node("Reshape", ["x", "shape"], ["y"])], "g", given, [made])
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
    path = tmp_path / "a.onnx"
    onnx.save(model, path)
    network = open_onnxruntime(path, Compute(1))
    with pytest.raises(BundleError, match="the network fails as it runs") as caught:
        network.run({"x": np.zeros((1, 4), np.float32), "shape": np.array([3, 3])})
    assert str(caught.value).isprintable()


EMPTY = "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855"  # of no bytes at all


def with_sums(folder, sums):
    """A bundle whose manifest names these files as well."""
    painted.write_painted(folder, [])
    document = json.loads((folder / "bundle.json").read_text())
    document["sha256"] |= sums
    (folder / "bundle.json").write_text(json.dumps(document))
    return folder


@pytest.mark.parametrize("digest", ["/home/u/evil", "../../evil", "A" * 64, "0" * 63, "0" * 64 + "\n", ""])
def test_a_sum_that_is_a_path_never_becomes_one(tmp_path, digest):
    assert "sha256" in refused(BundleError, read_manifest, with_sums(tmp_path / "b", {"extra.bin": digest}))


@pytest.mark.parametrize("name", ["bundle.json", "a/bundle.json", "../x", "/x", "a\\b", "x\x00", "\u202ex", "."])
def test_a_name_that_leaves_the_folder_is_never_copied(tmp_path, monkeypatch, name):
    monkeypatch.setenv("EDGEMAP_CACHE", str(tmp_path / "cache"))
    refused(BundleError, install_folder, with_sums(tmp_path / "b", {name: EMPTY}))
    assert not (tmp_path / "cache").exists()


def test_a_file_that_would_be_a_folder_too_is_one_line(tmp_path, monkeypatch):
    monkeypatch.setenv("EDGEMAP_CACHE", str(tmp_path / "cache"))
    folder = with_sums(tmp_path / "b", {"x": EMPTY, "x/y": EMPTY})
    (folder / "x").write_bytes(b"")
    refused(BundleError, install_folder, folder)


def test_wheels_that_jump_or_leave_the_world(tmp_path):
    path = tmp_path / "wheel{0}.csv"
    for rows, words in (
        ("0,0,0,0\n0.1,1000,0,0\n", "at 0.100 s the pose jumps 1000.0 m in 0.100 s"),
        ("0,0,0,0\n0.1,1e300,0,0\n", ":3: x_m is 1e+300, must be -1e+06 to 1e+06"),
        ("0,0,0,0\n\n0.1,nan,0,0\n", ":4: x_m is nan"),
        ("0,0,0\n", "expected 4 finite numbers"),
        ("0,0,0,x\n", ":2: '0 0 0 x', expected 4 finite numbers a line, stamp_s x_m y_m yaw_rad"),
        ("0,0,0,0\n0,0,0,0\n", "not after 0.000000 s"),
        ("", "no rows"),
    ):
        path.write_text("stamp_s,x_m,y_m,yaw_rad\n" + rows)
        assert words in refused(CameraError, read_wheel_csv, path)


def test_sightings_of_a_run(tmp_path):
    good = {"label": "chair", "object": "chair-9", "map_m": [1.0, 2.0]}
    (tmp_path / "sightings.jsonl").write_text(json.dumps(good) + "\n" + '{"label": "torn')
    (tmp_path / "run.json").write_text('{"merged": ' + "[" * 100_000)
    assert [record.object for record in sightings_file.read_sightings(tmp_path)] == ["chair-9"]
    (tmp_path / "run.json").write_text('{"merged": {"chair-9": "chair-1"}}')
    assert [record.object for record in sightings_file.read_sightings(tmp_path)] == ["chair-1"]
    for line in ("[" * 100_000, "{}", json.dumps(good | {"map_m": [1.0]}), json.dumps(good | {"label": None}), "\0"):
        (tmp_path / "sightings.jsonl").write_text(json.dumps(good) + "\n" + line + "\n")
        assert "sightings.jsonl:2: damaged line" in refused(MapError, sightings_file.read_sightings, tmp_path)


def test_messages_stay_one_line_and_what_is_no_file_is_refused(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    for path in (tmp_path / "pipe", tmp_path, tmp_path / "none", Path("a\0b")):
        assert "cannot be read" in refused(MapError, read_bytes, path, MapError, 100)
    (tmp_path / "large").write_bytes(bytes(101))
    assert "101 bytes, at most 100" in refused(MapError, read_bytes, tmp_path / "large", MapError, 100)
    assert one_line("a\r\nb\x1b[31m\u2028c\udc80") == "a b [31m c"
    assert len(one_line("x" * 10_000)) == 200
    (tmp_path / "a.png").write_bytes(png(20_000, 20_000))
    assert "picture of more than 67,108,864 px" in refused(CameraError, read_picture, tmp_path / "a.png")
    assert stated_focal_px(tmp_path / "a.png", 640, 480) is None


def test_a_picture_whose_name_a_terminal_would_act_on_is_refused(tmp_path):
    for name in ("a\x1b[2J.png", "a\nb.png", os.fsdecode(b"\xff.png")):
        folder = tmp_path / f"{len(name)}{ord(name[0])}"
        folder.mkdir()
        (folder / name).write_bytes(b"")
        with pytest.raises(CameraError, match="characters that do not print") as caught:
            list_pictures(folder)
        assert str(caught.value).isprintable()


def test_a_small_grid_of_many_bytes_takes_no_memory_for_them():
    head, data = io.BytesIO(), io.BytesIO()
    np.lib.format.write_array_header_1_0(head, {"descr": "|i1", "fortran_order": False, "shape": (8192, 8191)})
    parts: Any = {
        "origin_m": np.array([-0.5, 1.0]),
        "resolution_m": np.array(0.05),
        "thresholds": np.array([-1.1, 0.6]),
    }
    np.savez_compressed(data, **parts)
    with zipfile.ZipFile(data, "a", zipfile.ZIP_DEFLATED) as file:
        file.writestr("log_odds.npy", head.getvalue() + bytes(400 << 20))
    tracemalloc.start()
    with pytest.raises(MapError, match="at most"):
        read_grid(data.getvalue(), "bomb")
    assert tracemalloc.get_traced_memory()[1] < 8 << 20
    tracemalloc.stop()


@pytest.mark.parametrize("name", ["../grid.npz", "/etc/passwd", "a/grid.npz", "..", "a\\b.npz", ""])
def test_a_name_that_leaves_the_folder_is_refused(tmp_path, name):
    text = json.dumps({"format": "edgemap.map/1", "objects": [], "grid": name})
    (tmp_path / "map.json").write_text(text)
    with pytest.raises(MapError):
        load_grid(tmp_path)
