"""Files made to break a reader: each is one line of a typed error, in bounded memory, and nothing is written."""

import json
import os
from pathlib import Path

import cv2
import numpy as np
import pytest
from support import painted
from support.huge_png import png
from support.recordings import FACTS, noise, record
from support.refusal import refused

from edgemap.bridges.ros2.recordings.camera import RecordingCamera
from edgemap.bridges.ros2.recordings.facts import read_trajectory_file
from edgemap.bridges.ros2.recordings.foreign import read_wheel
from edgemap.geometry.errors import MapError
from edgemap.geometry.se2 import SE2
from edgemap.runtime.frames.errors import BundleError, CameraError, OdometryError
from edgemap.runtime.frames.number_rows import ROW_LIMIT
from edgemap.runtime.frames.reading import one_line, read_bytes
from edgemap.runtime.frames.trajectory import Trajectory, read_tum
from edgemap.runtime.inputs.drives.camera_yaml import read_camera_yaml
from edgemap.runtime.inputs.drives.pictures import PIXEL_LIMIT, picture_size, read_picture
from edgemap.runtime.inputs.drives.sensor_csv import read_wheel_csv
from edgemap.runtime.inputs.drives.truth import read_boxes, read_objects
from edgemap.runtime.network.bundle import load_bundle
from edgemap.runtime.network.manifest_file import read_manifest
from edgemap.runtime.network.store import install_folder
from edgemap.runtime.outputs.sightings_file import read_sightings
from edgemap.runtime.step.map_file import load_map

OBJECT = {
    "id": "chair-1", "label": "chair", "x_m": 1.0, "y_m": 2.0, "covariance_m2": [[0.01, 0.0], [0.0, 0.02]],
    "width_m": 0.5, "height_m": 0.9, "count": 7, "confidence": 0.9, "first_seen_s": 0.0, "last_seen_s": 3.0,
}  # fmt: skip


def write_map(path, text="", **changes):
    document = {"format": "edgemap.map/1", "frame": "map", "objects": [OBJECT | changes]}
    path.write_text(text or json.dumps(document))
    return path


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"x_m": float("inf")}, "not JSON"),
        ({"y_m": float("nan")}, "not JSON"),
        ({"count": 0}, "count`, found 0"),
        ({"count": 2.5}, "count`"),
        ({"confidence": 7}, "confidence`, found 7"),
        ({"id": "chair-" + "9" * 5000}, "at `$.objects[0].id`"),
        ({"id": "chair\n-1"}, "at `$.objects[0].id`"),
        ({"id": ""}, "at `$.objects[0].id`"),
        ({"covariance_m2": [[-0.01, 0], [0, 0.02]]}, "is no covariance"),
        ({"covariance_m2": [[0.01, 0.5], [0.5, 0.02]]}, "is no covariance"),
        ({"covariance_m2": [[0.01, 0.001], [0.002, 0.02]]}, "is no covariance"),
        ({"covariance_m2": [[0.01, 0.0]]}, "covariance_m2`"),
        ({"x_m": 10**400}, "at `$.objects[0].x_m`"),
        ({"width_m": -1}, "width_m`, found -1"),
        ({"last_seen_s": -1.0}, "last seen at -1.0 s, first at 0.0 s"),
        ({"label": 3}, "label`, found 3"),
    ],
)
def test_an_object_that_cannot_be_is_named_with_its_number(tmp_path, changes, words):
    assert words in refused(MapError, load_map, write_map(tmp_path / "map.json", **changes))


def test_maps_that_are_none(tmp_path):
    path = tmp_path / "map.json"
    good = json.dumps(OBJECT)
    for text, words in (
        ('{"format": "edgemap.map/1", "objects": ' + "[" * 100_000 + "]" * 100_000 + "}", "map.json"),
        ('{"x": ' + "[" * 100_000, "nested too deeply"),
        ('{"format": [[]]}', "not an edgemap.map/1 document"),
        (f'{{"format": "edgemap.map/1", "objects": [{good}, {good}]}}', "two objects have the id 'chair-1'"),
        (f'{{"format": "edgemap.map/1", "objects": [{good.replace("1.0", "1e999")}]}}', "out of range"),
        ("[]", "not an edgemap.map/1 document"),
        ("\0", "not JSON"),
    ):
        assert words in refused(MapError, load_map, write_map(path, text))
    path.write_bytes(
        json.dumps({"format": "edgemap.map/1", "objects": [OBJECT]}).encode().replace(b"chair", b"cha\xffr")
    )
    assert "not JSON" in refused(MapError, load_map, path)


def test_a_map_with_fields_of_a_later_edgemap_and_a_rounded_covariance_is_read(tmp_path):
    path = write_map(tmp_path / "map.json", labels={"chair": 1.0}, covariance_m2=[[0.0, 0.0], [0.0, 1e-9]])
    (item,) = load_map(path)
    assert np.linalg.eigvalsh(item.covariance_m2).min() > 0


def test_merge_refuses_what_show_refuses(edgemap, tmp_path):
    good, bad = write_map(tmp_path / "a.json"), write_map(tmp_path / "b.json", confidence=7)
    result = edgemap("map", "merge", good, bad, "-o", tmp_path / "out.json")
    assert result.returncode == 1
    assert len(result.stderr.splitlines()) == 1
    assert "confidence" in result.stderr


LENS = "{width: 640, height: 480, fx: 587.0, fy: 587.0, cx: 319.5, cy: 239.5"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (LENS + ", calibration: {done: 2026-01-01}}", "'timestamp' is not a plain value"),
        (LENS + ", calibration: !!python/object:os.system {}}", "is not a plain value"),
        (LENS + ", calibration: !!binary aGVsbG8=}", "is not a plain value"),
        ("a: &a [x]\nb: [*a, *a]", "an alias"),
        ("{" * 5000, "nested more than"),
        ("a: " + "9" * 5000, "a number of 5,000 digits"),
        (LENS.replace("587.0", "9" * 390, 1) + "}", "fx`"),
        ("!!int x", "not YAML"),
        ("!!bool x", "not YAML"),
        ('!!int ""', "not YAML"),
        ("{[1]: 2}", "a key that is no text"),
        ("{width: 1, width: 2}", "given twice"),
        ("a: \x01", "not YAML"),
        (LENS + ", distortion: {model: brown_conrady, coefficients: [1,2,3,4,5,6]}}", "coefficients"),
        (LENS.replace("640", "100000") + "}", "width`, found 100000"),
        ("", "Expected `object`"),
    ],
)
def test_camera_files(tmp_path, text, words):
    (tmp_path / "camera.yaml").write_text(text)
    assert words in refused(CameraError, read_camera_yaml, tmp_path / "camera.yaml")


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('"name": "painted"', '"name": "pain\\u0000ted"', "`$.name`"),
        ('"version": "1"', '"version": ' + "[" * 50_000, "version`"),
        ('"measured": {}', '"measured": {"a":' + "[" * 50_000 + "]" * 50_000 + "}", "nested too deeply"),
        ('"pad": 127', '"pad": 127000', "`$.detector.input.pad`, found 127000"),
        ('"width": 64', '"width": 999999999', "width`, found 999999999"),
        ('"anchors": [', '"anchors": [[1.0, 1.0], ', "head head has shape"),
        ('"stride": 32', '"stride": 0', "stride`, found 0"),
        ('"format": "', '"format": "' + "x" * 70_000, "xxx…, this edgemap reads"),
    ],
)
def test_manifests(tmp_path, old, new, words):
    folder = painted.write_painted(tmp_path / "b", [])
    text = (folder / "bundle.json").read_text()
    compact = json.dumps(json.loads(text))
    assert old in compact
    (folder / "bundle.json").write_text(compact.replace(old, new, 1))
    assert words in refused(BundleError, read_manifest, folder)


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


def test_metadata_that_is_no_utf8_is_one_line(tmp_path):
    folder = painted.write_painted(tmp_path / "b", [])
    path = folder / "backbone.onnx"
    path.write_bytes(path.read_bytes().replace(b"edgemap.contract", b"edgemap.contrac\xff"))
    painted.resum(folder)
    assert "backbone.onnx" in refused(BundleError, load_bundle, folder)


def test_wheel_tables(tmp_path):
    path = tmp_path / "wheel.csv"
    for rows, words in (
        ("0,0,0,0\n0.1," + "9" * 200_000 + ",0,0\n", "wheel.csv:3: a line of"),
        ("0,0,0,0\n0.1,1000,0,0\n", "line 3: the pose jumps 1000.0 m in 0.100 s"),
        ("0,0,0,0\n0.1,1e300,0,0\n", "x_m is 1e+300, must be"),
        ("0,0,0,0\n0.1,inf,0,0\n", "wheel.csv:3: expected 4 finite numbers"),
        ("0,0,0\n", "expected 4 finite numbers"),
        ("0,0,0,0\n0,0,0,0\n", "does not come after"),
        ("", "no rows"),
    ):
        path.write_text("stamp_s,x_m,y_m,yaw_rad\n" + rows)
        assert words in refused(CameraError, read_wheel_csv, path)
    path.write_bytes(b"stamp_s,x_m,y_m,yaw_rad\n\xff,0,0,0\n")
    assert "cannot be read" in refused(CameraError, read_wheel_csv, path)
    (tmp_path / "wheel{0}.csv").write_text("stamp_s,x_m,y_m,yaw_rad\n0,0,0,0\n1,999,0,0\n")
    assert "jumps 999.0 m" in refused(CameraError, read_wheel_csv, tmp_path / "wheel{0}.csv")


@pytest.mark.parametrize("quaternion", ["0 0 0 0", "0 0 0 5", "0 0 0 1e300", "nan 0 0 1"])
def test_quaternions_that_are_none(tmp_path, quaternion):
    (tmp_path / "a.tum").write_text(f"0 0 0 0 0 0 0 1\n1 0 0 0 {quaternion}\n")
    assert "a.tum:2: " in refused(OdometryError, read_tum, tmp_path / "a.tum")


def test_sightings_of_a_run(tmp_path):
    good = {"label": "chair", "object": "chair-9", "map_m": [1.0, 2.0]}
    (tmp_path / "sightings.jsonl").write_text(json.dumps(good) + "\n" + '{"label": "torn')
    (tmp_path / "run.json").write_text('{"merged": ' + "[" * 100_000)
    assert [record.object for record in read_sightings(tmp_path)] == ["chair-9"]
    (tmp_path / "run.json").write_text('{"merged": {"chair-9": "chair-1"}}')
    assert [record.object for record in read_sightings(tmp_path)] == ["chair-1"]
    for line in ("[" * 100_000, "{}", json.dumps(good | {"map_m": [1.0]}), json.dumps(good | {"label": None}), "\0"):
        (tmp_path / "sightings.jsonl").write_text(json.dumps(good) + "\n" + line + "\n")
        assert "sightings.jsonl:2: damaged line" in refused(MapError, read_sightings, tmp_path)


def test_truth_files(tmp_path):
    record = {"id": 1, "label": "chair", "x_m": 1.0, "y_m": 2.0}
    path = tmp_path / "x.json"
    for objects in ([record, record], [record | {"x_m": "1"}], [record | {"visible_frames": -1}], [[]], 3):
        path.write_text(json.dumps({"objects": objects}))
        refused(CameraError, read_objects, path)
    box = {"id": 1, "label": "chair", "box": [1, 2, 30, 40]}
    for frames in ([[box | {"box": [30, 2, 1, 40]}]], [[box | {"box": [1, 2, 3]}]], [[box | {"visible": 2}]], [box]):
        path.write_text(json.dumps({"frames": frames}))
        refused(CameraError, read_boxes, path)


def test_a_small_file_of_a_huge_picture_is_refused_before_it_is_decoded(tmp_path):
    (tmp_path / "a.png").write_bytes(png(20_000, 20_000))
    words = refused(CameraError, read_picture, tmp_path / "a.png")
    assert f"20000x20000 px, at most {PIXEL_LIMIT:,} px" in words
    (tmp_path / "a.png").write_bytes(png(1, 1 << 20))
    assert "1x1048576 px" in refused(CameraError, read_picture, tmp_path / "a.png")


@pytest.mark.parametrize("suffix", [".png", ".jpg", ".bmp", ".ppm", ".pgm", ".tif", ".webp"])
def test_sizes_are_read_as_opencv_reads_them(suffix):
    image = np.random.default_rng(0).integers(0, 255, (37, 53, 3), np.uint8)
    good, data = cv2.imencode(suffix, image[:, :, 0] if suffix == ".pgm" else image)
    assert good
    assert picture_size(data.tobytes()) == (53, 37)
    for cut in (0, 2, 10, 20):
        picture_size(data.tobytes()[:cut])  # no error


def test_a_pipe_a_folder_and_a_nul_are_no_files(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    for path in (tmp_path / "pipe", tmp_path, tmp_path / "none", Path("a\0b")):
        assert "cannot be read" in refused(MapError, read_bytes, path, 100, MapError)
    (tmp_path / "large").write_bytes(bytes(101))
    assert "101 bytes, at most 100" in refused(MapError, read_bytes, tmp_path / "large", 100, MapError)


def test_messages_stay_one_line():
    assert one_line("a\r\nb\x1b[31m\u2028c\udc80") == "a b [31m c"
    assert len(one_line("x" * 10_000)) == 200


def test_attachments_are_checked(tmp_path):
    way = Trajectory(np.array([0.0, 1.0]), (SE2(), SE2(1.0)))
    path = record(tmp_path / "a.mcap", FACTS, noise(3), wheel=way)
    data = path.read_bytes()
    at = data.index(b"[[0.0")
    path.write_bytes(data[:at] + b"[{0.0" + data[at + 5 :])
    assert "another sum" in refused(CameraError, RecordingCamera, str(path))
    assert "another sum" in refused(CameraError, read_wheel, str(path))


@pytest.mark.parametrize(
    "text", ["[", "{}", "[[0,0,0]]", "[[0,0,0,1e7]]", "[[1,0,0,0],[1,0,0,0]]", "[]", "[" * 100_000, '[["0",0,0,0]]']
)
def test_trajectories_in_recordings(text):
    refused(CameraError, read_trajectory_file, text.encode(), "a.mcap: wheel.json")


def test_a_trajectory_of_too_many_rows_is_refused_before_it_is_read():
    data = b"[" + b"[],".join(b"" for _ in range(2)) + b"[" * (ROW_LIMIT + 2)
    assert "more than 2,000,000 rows" in refused(CameraError, read_trajectory_file, data, "a.mcap")
