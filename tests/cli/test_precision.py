"""`--precision` and `--int8` as a user types them; the painted int8 file sees a couch where float32 sees a chair."""

import json
import shutil

import pytest
from support import painted

from edgemap.runtime.step.map_file import load_map

REPORT = {"time": 0.5, "processor": "Abacus 9", "ap50": {"float32": 0.7, "int8": 0.695}}


@pytest.fixture
def with_int8(tmp_path, painted_bundle):
    folder = shutil.copytree(painted_bundle, tmp_path / "bundle")
    return painted.with_int8(folder, [("couch", 40.0, 30.0, 12.0, 24.0, 0.9)], REPORT)


def labels(result):
    assert result.returncode == 0, result.stderr
    return [entry["label"] for document in json.loads(result.stdout) for entry in document["detections"]]


def test_detect_and_run_use_the_file_that_is_asked_for(edgemap, with_int8, pictures, tmp_path):
    detect = ("detect", pictures / "0.png", "--bundle", with_int8, "--json")
    assert labels(edgemap(*detect)) == ["chair", "person"]
    assert labels(edgemap(*detect, "--precision", "int8")) == ["couch"]
    out = tmp_path / "run"
    edgemap.ok("run", "--camera", pictures, "--bundle", with_int8, "--out", out, "--precision", "int8")
    assert [item.id for item in load_map(out)] == ["couch-1"]
    assert json.loads((out / "run.json").read_text())["precision"] == "int8"
    bench = ("bench", "--camera", pictures, "--bundle", with_int8, "--seconds", "0.2", "--precision", "int8", "--json")
    assert json.loads(edgemap(*bench).stdout)["precision"] == "int8"


def test_doctor_tells_what_the_variant_is_worth_and_that_it_is_whole(edgemap, with_int8, pictures):
    doctor = ("doctor", "--camera", pictures, "--bundle", with_int8)
    result = edgemap.ok(*doctor)
    assert "int8: 0.50 of float32's time on Abacus 9, AP50 0.695 against 0.700" in result.stdout
    with (with_int8 / "backbone.int8.onnx").open("ab") as stream:
        stream.write(b"x")
    result = edgemap(*doctor)
    assert result.returncode == 1
    assert "backbone.int8.onnx has sha256" in result.stdout


def test_bench_takes_a_detectors_file_and_counts_its_searches(edgemap, tmp_path):
    from support.foreign_models import Graph, class_columns, write

    file = write(class_columns(Graph()), tmp_path / "a.onnx")
    result = edgemap.ok("bench", "--bundle", file, "--seconds", "0.2", "--rate", "10", "--json")
    figures = json.loads(result.stdout)
    assert {"fps", "searched_hz"} <= figures.keys()
    assert figures["paced"]["10"]["searched_hz"] > 0.0
