"""Means, worst homes and what loop closure gives, by hand; drives that are found; frozen homes."""

import json

import pytest

from edgemap.benchmarks import rooms
from edgemap.benchmarks.rooms import AREAS, check_sums, drives_in, gains, over_homes, sums_of, table

CLOSED, OPEN = "with wheels", "with wheels, no closure"


def figures(f1, error_m=None):
    shares = dict.fromkeys(AREAS, f1) | {"f1": f1, "precision": f1, "recall": f1, "covered95": 0.9}
    return shares | {"median_error_m": error_m, "anees": 1.5, "ellipse_m2": 0.4}


def row(home, f1, error_m, unclosed):
    return {"home": home, "maps": {CLOSED: figures(f1, error_m), OPEN: figures(unclosed)}}


ROWS = [row("1", 0.8, 0.10, 0.7), row("2", 0.6, None, None), row("3", 0.4, 0.30, 0.44)]


def test_means_the_worst_home_and_what_loop_closure_gives():
    closed, unclosed = over_homes(ROWS, CLOSED), over_homes(ROWS, OPEN)
    assert (closed["mean"]["f1"], closed["mean"]["median_error_m"]) == pytest.approx((0.6, 0.2))
    assert (closed["worst"]["f1"], closed["worst"]["median_error_m"]) == (0.4, 0.30)
    assert unclosed["worst"]["median_error_m"] is None
    assert gains(ROWS, CLOSED, OPEN) == {"1": 0.1, "3": -0.04}
    assert table(ROWS)[-1] == "loop closure with wheels: F1 +0.030, worst -0.040 in 3"


def test_a_folder_of_drives_is_all_of_them_and_one_without_is_told(tmp_path):
    for name in ("9101", "9100"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "objects.json").write_text("[]")
    assert [drive.name for drive in drives_in((tmp_path,))] == ["9100", "9101"]
    assert drives_in((tmp_path / "9101",)) == [tmp_path / "9101"]
    (tmp_path / "none").mkdir()
    with pytest.raises(SystemExit, match="neither a drive"):
        drives_in((tmp_path / "none",))


def test_a_frozen_home_with_another_truth_is_refused(tmp_path, monkeypatch):
    home = tmp_path / "9200"
    home.mkdir()
    for name in ("objects.json", "poses.tum"):
        (home / name).write_text(name)
    with pytest.raises(SystemExit, match="not those of frozen home 9200"):
        check_sums(home)
    (tmp_path / "sums.json").write_text(json.dumps({"9200": sums_of(home)}))
    monkeypatch.setattr(rooms, "SUMS", tmp_path / "sums.json")
    check_sums(home)
