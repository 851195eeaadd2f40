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
