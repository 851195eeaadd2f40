"""Maps of others are scored as ours are."""

import json

import pytest

from edgemap.benchmarks import score
from edgemap.benchmarks.score import ScoreOptions, main, paired, read_csv
from edgemap.evaluation.objects import TrueObject
from edgemap.geometry.errors import MapError

CHAIR = TrueObject("chair", 1.0, 2.0, True, 50)
BED = TrueObject("bed", 3.0, 0.0, True, 50)


def test_a_table_of_labels_and_places_is_enough(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(score, "open_drive", lambda spec: spec)
    monkeypatch.setattr(score, "true_objects", lambda *_: [CHAIR, BED])
    monkeypatch.setattr(score, "true_floor", lambda _: None)
    for home in ("1", "2"):
        (tmp_path / "homes" / home).mkdir(parents=True)
        (tmp_path / "homes" / home / "objects.json").write_text("[]")
    (tmp_path / "maps").mkdir()
    (tmp_path / "maps" / "1.csv").write_text("label,x_m,y_m\nchair,1.1,2.0\nbed,3.0,0.6\n")
    main(ScoreOptions(tmp_path / "maps", tmp_path / "homes", json=True))
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
    monkeypatch.setattr(score, "true_floor", lambda _: None)
    (tmp_path / "objects.json").write_text("[]")
    table = tmp_path / "map.csv"
    for yaw, mean_iou, error in ((0.0, 1.0, 0.0), (1.5708, 0.33, 90.0)):
        table.write_text(f"label,x_m,y_m,width_m,depth_m,yaw_rad\nbed,3.0,0.0,2.0,1.0,{yaw}\n")
        main(ScoreOptions(table, tmp_path, json=True))
        (row,) = json.loads(capsys.readouterr().out)["homes"]
        assert row["footprint"]["mean_iou"] == pytest.approx(mean_iou, abs=0.03)
        assert row["footprint"]["yaw_error_deg"] == pytest.approx(error, abs=0.1)
