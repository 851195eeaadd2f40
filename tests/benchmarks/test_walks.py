"""Figures of walks by hand and one real walk; tables of other programs' objects; the README's figures."""

import json
import math

import numpy as np
import pytest

from edgemap.benchmarks import figures, score
from edgemap.benchmarks.score import main, paired, read_csv
from edgemap.benchmarks.walks import summary, table, walk, walk_errors
from edgemap.evaluation.objects import TrueObject
from edgemap.geometry.errors import MapError
from edgemap.geometry.se2 import SE2
from edgemap.runtime.frames.trajectory import Trajectory
from edgemap.runtime.inputs.drives import open_drive
from edgemap.runtime.network.bundle import load_bundle
from edgemap.runtime.network.store import bundle_folder
from edgemap.runtime.step.config import Config
from edgemap.runtime.step.slam import SlamOptions


def test_a_walk_that_is_a_tenth_too_long():
    truth = Trajectory(np.arange(41) / 10.0, tuple(SE2(0.25 * i, 0.0, 0.0) for i in range(41)))
    steps = [SE2(0.275, 0.0, 0.0)] * 40
    found = walk_errors(truth, truth.stamps_s.tolist(), steps, np.tile(np.eye(3) * 0.01, (40, 1, 1)))
    # A segment of L ends at the first frame beyond L: one step of 0.25 m more, each 10 % too long.
    assert found["t_rel_5"] == pytest.approx(100.0 * 0.1 * 5.25 / 5.0)
    assert found["scale"] == pytest.approx(1.1)
    assert found["r_rel_5"] == pytest.approx(0.0)
    assert found["end_m"] == pytest.approx(1.0)
    assert found["nees_1"] == pytest.approx((10 * 0.025) ** 2 / (10 * 0.01) / 3)


def test_a_turn_that_is_missed_counts_by_metre():
    truth = Trajectory(np.arange(3) / 10.0, (SE2(), SE2(6.0, 0.0, math.radians(12.0)), SE2(12.0, 1.0, 0.5)))
    found = walk_errors(truth, truth.stamps_s.tolist(), [SE2(6.0, 0.0, 0.0)] * 2, np.tile(np.eye(3), (2, 1, 1)))
    assert (found["r_rel_5"] or 0.0) > 2.0


def test_means_and_the_worst_run_of_each_figure():
    row = dict.fromkeys(summary([])["mean"], 1.0) | {"f1": 0.5, "scale": 0.8}
    rows = [row, row | {"t_rel_5": 3.0, "f1": 0.4, "scale": 1.1}, row | {"f1": None}]
    found = summary(rows)
    assert found["mean"]["t_rel_5"] == pytest.approx(5.0 / 3.0)
    assert (found["worst"]["t_rel_5"], found["worst"]["f1"], found["worst"]["scale"]) == (3.0, 0.4, 0.8)
    assert found["mean"]["f1"] == pytest.approx(0.45)
    assert len(table("walk", {"runs": rows, **found})) == 4


def test_a_real_walk(shared_data):
    folder = shared_data / "lounge"
    if not (folder / "depth").is_dir():
        pytest.skip(f"no {folder} with depth here")
    spec = f"c2w:{folder}"
    drive = open_drive(spec)
    assert len(drive.depth) == len(drive.images) == 90
    found = walk(drive, load_bundle(bundle_folder("edgemap-pico")), Config(), SlamOptions(), 30)
    assert found["lost"] == 0
    assert (found["t_rel_1"] or math.inf) < 15.0
    assert found["t_rel_5"] is None  # so far it does not go


CHAIR = TrueObject("chair", 1.0, 2.0, True, 50)
BED = TrueObject("bed", 3.0, 0.0, True, 50)


def test_a_table_of_labels_and_places_is_enough(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(score, "open_drive", lambda spec: spec)
    monkeypatch.setattr(score, "true_objects", lambda *_: [CHAIR, BED])
    for home in ("1", "2"):
        (tmp_path / "homes" / home).mkdir(parents=True)
        (tmp_path / "homes" / home / "objects.json").write_text("[]")
    (tmp_path / "maps").mkdir()
    (tmp_path / "maps" / "1.csv").write_text("label,x_m,y_m\nchair,1.1,2.0\nbed,3.0,0.6\n")
    main(tmp_path / "maps", tmp_path / "homes", json=True)
    found = json.loads(capsys.readouterr().out)
    assert [row["f1"] for row in found["homes"]] == [0.5, 0.0]  # the bed is 0.6 m off, home 2 has no map
    assert found["total"]["f1"] == 0.25
    assert "anees" not in found["homes"][0]  # no covariances are stated
    assert paired(tmp_path / "maps" / "1.csv", tmp_path / "homes" / "1")[0][1].name == "1"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("label,x_m\nchair,1\n", "no column y_m"),
        ("label,x_m,y_m\nchair,1,2\nchair,1,wide\n", ":3: expected a label and finite numbers"),
        ("label,x_m,y_m\nchair,1,nan\n", ":2: expected"),
        ("label,x_m,y_m\n,1,2\n", ":2: expected"),
    ],
)
def test_a_line_that_is_no_object_is_named(tmp_path, text, words):
    (tmp_path / "map.csv").write_text(text)
    with pytest.raises(MapError, match=words):
        read_csv(tmp_path / "map.csv")


def test_footprints_of_a_table_are_scored(tmp_path, monkeypatch, capsys):
    """A bed of 2 x 1 m along y, mapped right, and across."""
    corners = ((2.5, -1.0), (3.5, -1.0), (3.5, 1.0), (2.5, 1.0))
    monkeypatch.setattr(score, "open_drive", lambda spec: spec)
    monkeypatch.setattr(score, "true_objects", lambda *_: [TrueObject("bed", 3.0, 0.0, True, 50, corners)])
    (tmp_path / "objects.json").write_text("[]")
    table = tmp_path / "map.csv"
    for yaw, mean_iou, error in ((0.0, 1.0, 0.0), (1.5708, 0.33, 90.0)):
        table.write_text(f"label,x_m,y_m,width_m,depth_m,yaw_rad\nbed,3.0,0.0,2.0,1.0,{yaw}\n")
        main(table, tmp_path, json=True)
        (row,) = json.loads(capsys.readouterr().out)["homes"]
        assert row["footprint"]["mean_iou"] == pytest.approx(mean_iou, abs=0.03)
        assert row["footprint"]["yaw_error_deg"] == pytest.approx(error, abs=0.1)


def test_readme_the_page_and_the_charts_are_what_figures_json_gives():
    rows = json.loads(figures.JSON.read_text())
    for path, text in figures.pages(rows).items():
        assert path.read_text() == text, f"{path.name} differs: python -m edgemap.benchmarks.figures --show"
    assert set(figures.README_ROWS) <= {row["figure"] for row in rows}


@pytest.mark.parametrize(
    ("path", "found"),
    [
        ("mean/f1", {"": 0.8}),
        ("homes/*/f1", {"9000": 0.9, "9001": 0.7}),
        ("sequences/*/t/5", {"9000": 1.5}),
        ("walks/*/runs/*/f1", {"0": 0.5, "1": 0.6}),
    ],
)
def test_numbers_at_a_path(path, found):
    document = {
        "mean": {"f1": 0.8},
        "homes": [{"home": "9000", "f1": 0.9}, {"home": "9001", "f1": 0.7}],
        "sequences": {"drive:/homes/9000": {"t": {"5": 1.5}}, "drive:/homes/9001": {"t": {"5": None}}},
        "walks": {"c2w:/lounge": {"runs": [{"f1": 0.5}, {"f1": 0.6}]}},
    }
    assert dict(figures.values_at(document, path.split("/"))) == found
