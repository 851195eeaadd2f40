"""The demo that ships with the runtime: complete, consistent, small, credited."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from edgemap.runtime.inputs import demo
from edgemap.runtime.inputs.drives import open_drive

FOLDER = Path(demo.__file__).parent


@pytest.fixture(scope="module")
def drive():
    if not (FOLDER / "video.mp4").exists():
        pytest.skip("the demo has not been made: make demo")
    return open_drive(f"drive:{FOLDER}")


def test_every_picture_has_a_pose_and_boxes(drive):
    video = cv2.VideoCapture(str(FOLDER / "video.mp4"))
    count = 0
    while True:
        more, image = video.read()
        if not more:
            break
        assert image.shape == (480, 640, 3)
        count += 1
    assert drive.truth is not None
    assert count == len(drive.truth.poses) == len(drive.boxes) == len(drive.stamps_s)
    assert 550 <= count <= 650
    assert video.get(cv2.CAP_PROP_FPS) == pytest.approx(10.0)
    np.testing.assert_allclose(drive.stamps_s, np.arange(count) / 10.0, atol=1e-9)


def test_truth_starts_at_the_origin(drive):
    first = drive.truth.poses[0]
    assert (first.x_m, first.y_m, first.yaw_rad) == pytest.approx((0.0, 0.0, 0.0), abs=1e-9)


def test_boxes_stand_where_the_objects_are(drive):
    """An object's footprint centre, seen from the true pose, projects between its box's left and right edges."""
    import json

    frames = json.loads((FOLDER / "boxes.json").read_text())["frames"]
    objects = {o["id"]: o for o in json.loads((FOLDER / "objects.json").read_text())["objects"]}
    rotation, position = drive.mount.rotation_base_optical(), drive.mount.position_base_m()
    checked = 0
    for pose, records in zip(drive.truth.poses, frames, strict=True):
        for record in records:
            if record["visible"] < 0.95:
                continue
            thing = objects[record["id"]]
            base = pose.inverse().apply([thing["x_m"], thing["y_m"]])
            column = drive.intrinsics.project((np.append(base, 0.3) - position) @ rotation)[0, 0]
            assert record["box"][0] < column < record["box"][2], thing
            checked += 1
    assert checked > 100


def test_enough_to_map_and_light_enough_to_ship():
    import json

    objects = json.loads((FOLDER / "objects.json").read_text())["objects"]
    scorable = [o for o in objects if o["on_floor"] and o["visible_frames"] >= 10]
    assert len(scorable) >= 8
    assert len({o["label"] for o in scorable}) >= 4
    assert sum(path.stat().st_size for path in FOLDER.iterdir() if path.is_file()) < 8_000_000


def test_every_model_is_credited(furniture_catalogue):
    text = (FOLDER / "README.md").read_text()
    keys = [line.split("`")[1] for line in text.splitlines() if line.startswith("| ") and "`" in line]
    assert len(keys) > 8
    for key in keys:
        assert furniture_catalogue[key].creator in text
