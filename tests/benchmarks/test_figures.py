"""The pages are made of figures.json and show nothing else; numbers are read from a command's JSON."""

import json

import pytest

from edgemap.benchmarks import figures


def test_readme_the_page_and_the_charts_are_what_figures_json_gives():
    for path, text in figures.pages(json.loads(figures.JSON.read_text())).items():
        assert path.read_text() == text, f"{path.name} differs: python -m edgemap.benchmarks.figures --show"


def test_every_figure_of_the_readme_is_there():
    assert set(figures.README_ROWS) <= {row["figure"] for row in json.loads(figures.JSON.read_text())}


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
