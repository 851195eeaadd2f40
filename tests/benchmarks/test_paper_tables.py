"""The paper's tables on hand-made drives: a network that paints, wheels that go too far, a head that counts steps."""

import json
import math
import re

import cv2
import numpy as np
import pytest
from support.painted import with_floor, write_painted
from support.pictures import noise

from edgemap.benchmarks.paper_page import page
from edgemap.benchmarks.paper_tables import main, measure
from edgemap.geometry.camera.intrinsics import Intrinsics
from edgemap.geometry.camera.mount import Mount
from edgemap.geometry.se2 import SE2
from edgemap.runtime.frames.trajectory import Trajectory
from edgemap.runtime.inputs.drives import CameraFile, write_drive
from edgemap.runtime.network.bundle import load_bundle

pytestmark = pytest.mark.slow
COUNTS = {"one": 104, "two": 41}
CHAIR = [68.0, 27.0, 92.0, 63.0]  # where the network below sees one, in the 128x96 picture


def write(folder, share, boxes):
    """0.1 m ahead in each picture; wheels too long by a share."""
    (folder / "images").mkdir(parents=True)
    stamps_s = np.arange(len(boxes)) / 10
    for index in range(len(boxes)):  # patches without a motion, and too few to search each picture for the last one's
        patches = np.kron(noise(index, (4, 4, 3)), np.ones((24, 32, 1), np.uint8))
        cv2.imwrite(str(folder / "images" / f"{index}.png"), patches)
    way = tuple(SE2(0.1 * i, 0, 0) for i in range(len(boxes)))
    wheel = [(stamp, (1 + share) * pose.x_m, 0, 0) for stamp, pose in zip(stamps_s, way, strict=True)]
    camera = CameraFile(Intrinsics(128, 96, 100.0, 100.0, 63.5, 47.5), Mount.from_degrees(0.5, 20.0), 10.0)
    write_drive(folder, camera, Trajectory(stamps_s, way), boxes=boxes, wheel=wheel)
    return f"drive:{folder}"


@pytest.fixture(scope="module")
def drives(tmp_path_factory):
    folder = tmp_path_factory.mktemp("drives")
    chair = {"id": 1, "label": "chair", "box": CHAIR, "visible": 1.0}
    hidden = {"id": 2, "label": "chair", "box": [0, 0, 30, 40], "visible": 0.1}
    couch = {"id": 3, "label": "couch", "box": [0, 0, 30, 40], "visible": 1.0}
    first = [[chair, hidden, couch]] * COUNTS["one"]
    # An unknown label is left out; in the other nothing is where the network sees a chair.
    second = [[{**couch, "label": "lamp"}]] * COUNTS["two"]
    return {"one": write(folder / "one", 0.05, first), "two": write(folder / "two", 0.10, second)}


def rmse(name, share):
    """Of wheels that go too far by a share."""
    return 0.1 * share * math.sqrt(np.mean(np.arange(COUNTS[name]) ** 2))


def painted(folder, trained):
    bundle = write_painted(folder, [("chair", 40.0, 30.0, 12.0, 24.0, 0.9)], odometry=trained)
    return with_floor(bundle, np.ones((1, 1, 8, 8)), 8)  # else a companion would search noise for it


@pytest.fixture(scope="module")
def measured(drives, tmp_path_factory):
    folder = tmp_path_factory.mktemp("tables")
    return measure(drives, load_bundle(painted(folder / "b", True)), None, folder)


def test_detections_are_counted_in_at_most_a_hundred_frames(measured):
    one, two = measured["detections"]["one"], measured["detections"]["two"]
    assert (one["frames"], two["frames"]) == (100, 41)
    assert one["chair"] == {"true": 100, "found": 100, "false": 0, "missed": 0}
    assert one["mapped"] == {"true": 200, "found": 100, "false": 0, "missed": 100}
    assert two["chair"] == {"true": 0, "found": 0, "false": 41, "missed": 0}


def test_each_odometry_has_its_own_figures(measured):
    wheels = measured["odometry"]["wheels"]["sequences"]
    # Segments of 5 m end 5.1 m on, one too late for rounding at most.
    assert wheels["one"]["t_rel_percent"]["5"] == pytest.approx(5.1, rel=0.03)
    assert wheels["two"]["paper_rmse"] == pytest.approx(rmse("two", 0.10), rel=1e-3)
    # The painted head goes 0.01 k at step k: at the end 0.005 n (n + 1) instead of 0.1 n.
    steps = np.arange(COUNTS["one"])
    expected = math.sqrt(np.mean((0.005 * steps * (steps + 1) - 0.1 * steps) ** 2))
    assert measured["odometry"]["paper head"]["sequences"]["one"]["paper_rmse"] == pytest.approx(expected, rel=1e-4)
    assert not measured["lacking"]


def test_the_page_shows_what_was_measured_beside_the_papers_own(measured):
    text = page(measured)
    assert "| one | 100 | 100 | 100 | 0 | 0 | 200 | 100 | 0 | 100 |" in text
    assert "| **all** | 141 | 100 | 100 | 41 | 0 | 200 | 100 | 41 | 100 |" in text
    assert "| 1 | 124 | 116 | 2 | 10 |" in text
    assert "| 5 | 106.3202 |" in text
    assert "| 07 | 14.45 | 3.91 | 41.56 |" in text
    lines = text.splitlines()
    row = lines[lines.index("## Table 3: eq. 9, RMSE of integrated positions") :]
    own = next(line for line in row if line.startswith("| one |")).split(" | ")
    assert own[-1] == f"{rmse('one', 0.05):.2f} |"
    mean = next(line for line in row if line.startswith("| **mean** |")).split(" | ")
    assert float(mean[-1].strip(" |")) == pytest.approx((rmse("one", 0.05) + rmse("two", 0.10)) / 2.0, abs=0.01)


def test_rooms_and_roads_have_means_of_their_own(measured):
    own = measured["odometry"]["wheels"]["sequences"]["one"]
    sequences = {name: {**own, "ate_m": ate} for name, ate in (("a", 0.1), ("b", 0.3), ("c", 7.0), ("d", 9.0))}
    data = {"a": "drive:a", "b": "c2w:b", "c": "kitti:c", "d": "kitti:d"}
    changed = {"data": data, "detections": dict.fromkeys(data), "odometry": {"wheels": {"sequences": sequences}}}
    ate = page(measured | changed).split("ATE in metres, RMSE", 1)[1]
    assert "| **mean indoors** | – | – | – | 0.20 |" in ate
    assert "| **worst indoors** | – | – | – | 0.30 |" in ate
    assert "| **mean on roads** | – | – | – | 8.00 |" in ate


def test_an_untrained_head_is_a_dash_with_its_reason_and_files_are_written(drives, tmp_path, capsys):
    bundle = painted(tmp_path / "b", False)
    main(data=(drives["two"], "demo"), bundle=str(bundle), frames=10, threads=1, out=tmp_path / "out")
    text = (tmp_path / "out" / "paper_tables.md").read_text()
    assert "- paper head: the bundle's paper head is untrained." in text
    assert re.search(r"\| demo \| [\d.]+ \| – \|", text)
    document = json.loads((tmp_path / "out" / "paper_tables.json").read_text())
    assert list(document["odometry"]) == ["hybrid", "hybrid with wheels", "wheels"]
    assert capsys.readouterr().out.strip() == str(tmp_path / "out" / "paper_tables.md")


def test_without_data_the_program_ends_with_a_line(tmp_path):
    bundle = painted(tmp_path / "b", False)
    with pytest.raises(SystemExit, match="expected A:B"):
        main(bundle=str(bundle), out=tmp_path)
