"""What a notebook shows of results and maps, and detections of another package."""

import re
import xml.etree.ElementTree as ElementTree
from base64 import b64decode
from html.parser import HTMLParser

import cv2
import numpy as np
import pytest
from support.steps import Steps

from edgemap.geometry.observations.detections import Detections
from edgemap.runtime.frames.supervision_boxes import to_supervision
from edgemap.runtime.outputs.map_objects import MapObjects


def drive(count=12):
    steps = Steps()
    return [steps.next() for _ in range(count)]


def test_a_result_is_its_picture_with_boxes():
    result, _ = drive()[-1]
    shown = cv2.imdecode(np.frombuffer(result._repr_png_(), np.uint8), cv2.IMREAD_COLOR)
    changed = (shown != result.frame.image).any(axis=2)
    assert changed[60:161, 40].mean() > 0.9  # the left side of the chair's box
    assert not changed[200:, :260].any()  # nothing is drawn where there is no box
    plain = cv2.imdecode(np.frombuffer(result.frame._repr_png_(), np.uint8), cv2.IMREAD_COLOR)
    np.testing.assert_array_equal(plain, result.frame.image)


def test_a_map_is_a_drawing_that_stands_alone_over_a_table():
    result, objects = drive()[-1]
    text = MapObjects(objects, result.trajectory)._repr_html_()
    (drawn,) = re.findall(r"svg\+xml;base64,([^\"]+)", text)
    drawing = ElementTree.fromstring(b64decode(drawn))
    named = " ".join(drawing.itertext())
    assert all(item.id in named for item in objects)
    assert drawing.find(".//{http://www.w3.org/2000/svg}style") is not None
    assert [element for element in drawing.iter() if element.get("stroke") == "#7f8a97"]  # the trajectory
    cells = []

    class Cells(HTMLParser):
        def handle_data(self, data):
            cells.append(data)

    Cells().feed(text)
    (chair,) = [item for item in objects if item.label == "chair"]
    at = cells.index(chair.id)
    assert cells[at + 1 : at + 3] == [f"{value:.2f} m" for value in chair.position_m]


def test_an_empty_map_shows_too():
    assert "map of 0 objects" in MapObjects()._repr_html_()


FOUND = Detections(
    np.array([[1.0, 2, 30, 40], [5, 6, 70, 80]]), np.array([0.75, 0.5]), np.array([2, 0]), ("bed", "cat", "chair")
)


def test_detections_go_to_supervision():
    supervision = pytest.importorskip("supervision")
    theirs = to_supervision(FOUND)
    assert isinstance(theirs, supervision.Detections)
    assert theirs.area.tolist() == [29 * 38, 65 * 74]
    assert list(theirs.data["class_name"]) == ["chair", "bed"]
    assert len(to_supervision(Detections.none(FOUND.names))) == 0
