"""Real weights, real pictures, librealsense's own recordings: the whole path as a user runs it."""

import json

import cv2
import numpy as np
import pytest
from support.tum import read_tum

from edgemap.runtime.inputs.drives.pictures import read_picture
from edgemap.runtime.step.map_file import load_map

pytestmark = pytest.mark.slow


def found_in(edgemap, bundle, picture, *flags):
    document = json.loads(edgemap("detect", picture, "--bundle", bundle, "--json", *flags).stdout)
    return {entry["label"] for entry in document[0]["detections"]}


@pytest.mark.parametrize("name", ["yolov3-tiny", "yolox-nano"])
def test_the_well_known_pictures(edgemap, real_bundles, shared_data, name):
    dog = found_in(edgemap, real_bundles / name, shared_data / "pictures" / "dog.jpg")
    assert {"dog", "bicycle"} <= dog
    assert dog & {"car", "truck"}
    person = found_in(edgemap, real_bundles / name, shared_data / "pictures" / "person.jpg")
    assert {"person", "dog"} <= person
    if name == "yolox-nano":
        assert "horse" in person


@pytest.mark.parametrize(("name", "odometry", "frames"), [("yolov3-tiny", "hybrid", 60), ("yolox-nano", "truth", 30)])
def test_a_real_living_room_becomes_a_map(edgemap, real_bundles, shared_data, tmp_path, name, odometry, frames):
    camera = f"c2w:{shared_data / 'hololens'}"
    flags = ("--frames", frames, "--odometry", odometry, "--out", tmp_path / "run")
    result = edgemap("run", "--camera", camera, "--bundle", real_bundles / name, *flags)
    assert result.returncode == 0, result.stderr
    assert load_map(tmp_path / "run")
    assert len(read_tum(tmp_path / "run" / "trajectory.tum").poses) == frames
    assert edgemap("map", "show", tmp_path / "run").returncode == 0


def test_ap50_is_what_these_weights_are_known_for(edgemap, real_bundles, shared_data):
    """Measured elsewhere on the same pictures: YOLOv3-tiny 0.289 letterboxed, YOLOX-Nano 0.508."""
    for name, expected in (("yolov3-tiny", 0.289), ("yolox-nano", 0.508)):
        flags = ("--bundle", real_bundles / name, "--json")
        figures = json.loads(edgemap("eval", "detection", "--data", f"yolo:{shared_data / 'coco128'}", *flags).stdout)
        assert figures["ap50"] == pytest.approx(expected, abs=0.015)
        assert figures["pictures"] == 128


def test_a_realsense_recording_gives_the_boxes_of_the_picture_folder(edgemap, real_bundles, shared_data, tmp_path):
    pytest.importorskip("pyrealsense2")
    from reliability.record_realsense import CX, CY, FX, FY, record_realsense

    sources = sorted((shared_data / "hololens" / "image").glob("*.jpg"))[40:70:3]
    pictures = [cv2.resize(read_picture(path), (640, 480)) for path in sources]
    (tmp_path / "pictures").mkdir()
    for index, picture in enumerate(pictures):
        cv2.imwrite(str(tmp_path / "pictures" / f"{index:03d}.png"), picture)
    stamps = [50.0 + index / 30 for index in range(len(pictures))]
    recording = record_realsense(tmp_path / "drive.db3", [picture[:, :, ::-1] for picture in pictures], stamps)

    flags = ("--bundle", real_bundles / "yolox-nano", "--mount", "1.62,22.9", "--out")
    played = edgemap("run", "--camera", f"realsense:{recording}", *flags, tmp_path / "played")
    assert played.returncode == 0, played.stderr
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
