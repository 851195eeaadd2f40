"""Real weights, real pictures, librealsense's own recordings: the whole path as a user runs it."""

import json

import cv2
import numpy as np
import pytest
from support.tum import read_tum

from edgemap.runtime.inputs.drives.pictures import read_picture
from edgemap.runtime.step.map_file import load_map

pytestmark = pytest.mark.slow


def test_the_well_known_pictures_and_a_real_living_room_that_becomes_a_map(edgemap, shared_data, tmp_path):
    flags = ("--bundle", "yolox-nano", "--json")
    for picture, labels in (("dog.jpg", {"dog", "bicycle"}), ("person.jpg", {"person", "dog", "horse"})):
        (document,) = json.loads(edgemap("detect", shared_data / "pictures" / picture, *flags).stdout)
        assert labels <= {entry["label"] for entry in document["detections"]}
    flags = ("--frames", 30, "--bundle", "yolox-nano", "--odometry", "truth", "--out", tmp_path / "run")
    edgemap.ok("run", "--camera", f"c2w:{shared_data / 'hololens'}", *flags)
    assert load_map(tmp_path / "run")
    assert len(read_tum(tmp_path / "run" / "trajectory.tum").poses) == 30
    assert edgemap("map", "show", tmp_path / "run").returncode == 0


def test_a_realsense_recording_gives_the_boxes_of_the_picture_folder(edgemap, shared_data, tmp_path):
    pytest.importorskip("pyrealsense2")
    from reliability.record_realsense import CX, CY, FX, FY, record_realsense

    sources = sorted((shared_data / "hololens" / "image").glob("*.jpg"))[40:70:6]
    pictures = [cv2.resize(read_picture(path), (640, 480)) for path in sources]
    (tmp_path / "pictures").mkdir()
    for index, picture in enumerate(pictures):
        cv2.imwrite(str(tmp_path / "pictures" / f"{index:03d}.png"), picture)
    stamps = [50.0 + index / 30 for index in range(len(pictures))]
    recording = record_realsense(tmp_path / "drive.db3", [picture[:, :, ::-1] for picture in pictures], stamps)

    flags = ("--bundle", "yolox-nano", "--mount", "1.62,22.9", "--out")
    edgemap.ok("run", "--camera", f"realsense:{recording}", *flags, tmp_path / "played")
    lens = ("--intrinsics", f"{FX},{FY},{CX},{CY}")
    assert edgemap("run", "--camera", tmp_path / "pictures", *flags, tmp_path / "folder", *lens).returncode == 0

    def boxes(run):
        lines = [json.loads(line) for line in (tmp_path / run / "sightings.jsonl").read_text().splitlines()]
        return [(line["frame"], line["label"], line["box_px"], line["score"]) for line in lines]

    assert boxes("played") == boxes("folder")
    assert len(boxes("played")) >= 5
    record = json.loads((tmp_path / "played" / "run.json").read_text())
    assert record["intrinsics"]["fx"] == pytest.approx(FX, abs=1e-3)
    assert record["intrinsics"]["cy"] == pytest.approx(CY, abs=1e-3)
    np.testing.assert_allclose(read_tum(tmp_path / "played" / "trajectory.tum").stamps_s, stamps, atol=1e-4)
