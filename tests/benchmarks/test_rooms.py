"""Means and worst homes of the rooms benchmark by hand, and which drives it finds."""

import pytest

from edgemap.benchmarks.rooms import drives_in, mean, table, worst


def row(clustering, f1, error_m):
    figures = {"f1": f1, "precision": f1, "recall": f1, "median_error_m": error_m, "covered95": 0.9}
    return {"clustering": clustering, "true": figures, "estimated": figures | {"f1": None}}


ROWS = [row("default", 0.8, 0.10), row("paper", 0.1, 1.0), row("default", 0.6, None), row("default", 0.4, 0.30)]


def test_means_and_the_worst_home_of_each_figure():
    assert mean(ROWS, "default", "true")["f1"] == pytest.approx(0.6)
    assert mean(ROWS, "default", "true")["median_error_m"] == pytest.approx(0.2)
    assert worst(ROWS, "default", "true")["f1"] == 0.4
    assert worst(ROWS, "default", "true")["median_error_m"] == 0.30
    assert worst(ROWS, "default", "estimated")["f1"] is None


def test_the_table_has_two_lines_for_each_clustering_and_kind_of_poses():
    lines = table(ROWS, "hybrid")
    assert len(lines) == 9
    assert lines[1].split() == ["default", "true", "mean", "0.600", "0.600", "0.600", "0.200", "0.900"]
    assert lines[3].split()[:4] == ["default", "hybrid", "mean", "–"]
    assert lines[6].split() == ["worst", "0.100", "0.100", "0.100", "1.000", "0.900"]


def test_a_folder_of_drives_is_all_of_them(tmp_path):
    for name in ("9101", "9100"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "objects.json").write_text("[]")
    assert [drive.name for drive in drives_in((tmp_path,))] == ["9100", "9101"]
    assert drives_in((tmp_path / "9101",)) == [tmp_path / "9101"]


def test_a_folder_without_drives_is_told(tmp_path):
    with pytest.raises(SystemExit, match="neither a drive"):
        drives_in((tmp_path,))
