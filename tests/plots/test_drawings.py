"""Figures: plates that cover nothing, a diagram without objects."""

from itertools import combinations

import cv2
import numpy as np
import pytest

from edgemap.geometry.observations.detections import Detections
from edgemap.runtime.step import overlay
from edgemap.runtime.step.overlay import draw_detections

pytest.importorskip("matplotlib", reason="figures need the extra 'plot'")
from edgemap.plots.charts import plot_reliability


def overlap(a, b):
    return min(a[2], b[2]) - max(a[0], b[0]) > 1 and min(a[3], b[3]) - max(a[1], b[1]) > 1


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
        assert drawing.std() > 1.0
