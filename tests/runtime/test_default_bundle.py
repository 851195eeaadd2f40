"""A source without `--bundle` gets the model that knows its pictures."""

import re
import shutil

import pytest
from support.recordings import noise, record

from edgemap.bridges.ros2.recordings.facts import Facts
from edgemap.runtime.inputs.cameras.kinds import recorded_from
from edgemap.runtime.network.bundle import load_bundle
from edgemap.runtime.network.manifest_file import read_manifest
from edgemap.runtime.network.store import LENS, RENDERED, bundle_folder, default_bundle


@pytest.mark.parametrize("spec", ["demo", "sim:8000", "drive:home"])
def test_rendered_pictures_get_the_bundle_of_rendered_rooms(spec):
    assert default_bundle(spec) == (RENDERED, f"trained for rendered pictures, as those of {spec}")


@pytest.mark.parametrize(
    "spec",
    ["realsense", "realsense:a.db3", "0", "/dev/video0", "drive.mp4", "pictures/", "kitti:a", "tum:a", "c2w:a"]
    + ["locobot:a", "yolo:a", "rtsp://robot/camera", "gone.mcap", "photo.jpg"],
)
def test_pictures_of_a_lens_get_the_bundle_of_photographs(spec):
    assert default_bundle(spec) == (LENS, f"trained for real cameras, as {spec} is")


def test_one_lens_among_rendered_sources_decides():
    assert default_bundle("demo", "kitti:a") == (LENS, "trained for real cameras, as kitti:a is")


@pytest.mark.parametrize(("camera", "expected"), [("demo", RENDERED), ("sim:4", RENDERED), ("realsense", LENS)])
def test_a_recording_gets_the_bundle_of_what_was_recorded(tmp_path, camera, expected):
    tape = record(tmp_path / "a.mcap", Facts(camera), noise(2))
    assert default_bundle(recorded_from(f"{tape}#/camera"))[0] == expected


def test_training_pictures_that_were_rendered_are_known_by_their_record(tmp_path):
    (tmp_path / "simulation.json").write_text("{}")
    assert default_bundle(f"yolo:{tmp_path}")[0] == RENDERED


@pytest.mark.parametrize("name", [LENS, RENDERED])
def test_both_come_with_the_package(name, tmp_path, monkeypatch):
    monkeypatch.setenv("EDGEMAP_CACHE", str(tmp_path))
    manifest = read_manifest(bundle_folder(name))
    assert manifest.licence.startswith("Apache-2.0")
    assert [head.trained for head in manifest.odometry.values()] == ([True] if name == RENDERED else [])
    load_bundle(bundle_folder(name), 1)


def test_a_bundle_in_the_cache_does_not_stand_for_the_one_of_its_name_that_comes_with_edgemap(tmp_path, monkeypatch):
    monkeypatch.setenv("EDGEMAP_CACHE", str(tmp_path))
    shipped = bundle_folder(RENDERED)
    cached = tmp_path / "bundles" / RENDERED
    shutil.copytree(shipped, cached)
    manifest = cached / "bundle.json"
    manifest.write_text(re.sub(r'("backbone.onnx": ")[0-9a-f]{8}', r"\g<1>00000000", manifest.read_text()))
    assert bundle_folder(RENDERED) == shipped
    shutil.copytree(shipped, tmp_path / "bundles" / "my-flat")
    assert bundle_folder("my-flat") == tmp_path / "bundles" / "my-flat"
