"""Drawings for people: names that cover nothing, legends that name all that is drawn, axes that end with the data."""

from itertools import combinations

import cv2
import numpy as np
import pytest

from edgemap.geometry.map_object import MapObject
from edgemap.geometry.objects.edits import Zone
from edgemap.geometry.observations.detections import Detections
from edgemap.geometry.se2 import SE2
from edgemap.runtime.frames.trajectory import Trajectory
from edgemap.runtime.step import overlay
from edgemap.runtime.step.overlay import draw_detections

pytest.importorskip("matplotlib", reason="figures need the extra 'plot'")
from edgemap.plots import floor_map
from edgemap.plots.charts import plot_reliability
from edgemap.plots.floor_map import SeenAt, plot_map

PLACES = [(0.0, 0.0), (0.15, 0.1), (-0.1, 0.2), (0.1, -0.25), (3.0, 1.0), (3.1, 1.3)]
LABELS = ["chair", "dining table", "potted plant", "chair", "refrigerator", "vase"]


def mapped():
    return [
        MapObject(f"{label}-{n}", label, np.array(at), 0.01 * np.eye(2), 0.5, 0.9, 9, 0.9, 0.0, 1.0)
        for n, (label, at) in enumerate(zip(LABELS, PLACES, strict=True), 1)
    ]


@pytest.fixture
def drawn(monkeypatch, tmp_path):
    """drawn(objects, …) -> the figure of `plot_map`."""
    kept = []
    monkeypatch.setattr(floor_map, "save", lambda figure, path: kept.append(figure) or path)

    def draw(*parts, **more):
        plot_map(tmp_path / "map.png", *parts, **more)
        kept[-1].canvas.draw()
        return kept[-1]

    yield draw
    for figure in kept:
        floor_map.plt.close(figure)


def overlap(a, b):
    return min(a[2], b[2]) - max(a[0], b[0]) > 1 and min(a[3], b[3]) - max(a[1], b[1]) > 1


def test_names_of_objects_that_stand_close_do_not_cover_each_other(drawn):
    figure = drawn(mapped())
    boxes = [text.get_window_extent().extents for text in figure.axes[-1].texts]
    assert len(boxes) == len(PLACES)
    assert not [pair for pair in combinations(boxes, 2) if overlap(*pair)]


def test_the_legend_names_all_that_is_drawn(drawn):
    way = Trajectory(np.array([0.0, 1.0]), (SE2(), SE2(1.0, 0.0, 0.0)))
    seen = [SeenAt("chair", "chair-1", 0.0, 0.0), SeenAt("tv", "", 1.0, 1.0)]
    zones = [Zone("zone-1", "kitchen", ((0.0, 0.0), (1.0, 0.0), (1.0, 1.0)))]
    figure = drawn(mapped(), seen, way, [("bed", 1.0, 1.0)], zones)
    told = {text.get_text() for text in figure.legends[0].get_texts()}
    marks = {*LABELS, "tv", "bed"}
    assert told == marks | {
        "95 % ellipse", "trajectory", "start", "end", "sighting of no object", "true place (mark of its class)", "zone",
    }  # fmt: skip
    assert "kitchen" in {text.get_text() for text in figure.axes[-1].texts}


def test_axes_end_where_the_data_ends(drawn):
    """0.245 m of ellipse beyond the outermost objects, and a margin of 0.3 m."""
    axes = drawn(mapped()).axes[0]
    assert axes.get_ylim() == pytest.approx((-0.1 - 0.245 - 0.3, 3.1 + 0.245 + 0.3), abs=0.01)
    assert axes.get_xlim() == pytest.approx((1.3 + 0.245 + 0.3, -0.25 - 0.245 - 0.3), abs=0.01)


def test_an_empty_map_is_drawn(drawn):
    assert drawn([]).axes[0].texts[0].get_text() == "no objects"


def test_plates_of_boxes_that_share_a_corner_stay_apart(monkeypatch):
    """Three boxes with one corner; the texts' plates are what is filled."""
    plates, real = [], cv2.rectangle

    def watched(picture, first, last, colour, thickness, *more):
        if thickness == -1:
            plates.append((*first, *last))
        return real(picture, first, last, colour, thickness, *more)

    monkeypatch.setattr(overlay.cv2, "rectangle", watched)
    boxes = np.array([[100.0, 100, 200, 200], [100, 100, 220, 240], [105, 102, 300, 180]])
    draw_detections(
        np.zeros((480, 640, 3), np.uint8), Detections(boxes, np.full(3, 0.9), np.arange(3), ("chair", "bed", "tv")), []
    )
    assert len(plates) == 3
    assert not [pair for pair in combinations(plates, 2) if overlap(*pair)]


def test_a_reliability_diagram_is_drawn_without_objects_too(tmp_path):
    bins = [{"from": 0.9, "to": 1.0, "objects": 4, "real": 3, "mean_confidence": 0.95}]
    for name, told in (("some", {"ece": 0.2, "bins": bins}), ("none", {"ece": None, "bins": []})):
        drawing = cv2.imread(str(plot_reliability(tmp_path / f"{name}.png", told)))
        assert drawing is not None
        assert drawing.std() > 1.0
