"""The map from above as SVG and PNG, everything within the sheet; marks that every eye tells apart; what a notebook
shows of results and maps, boxes whose plates cover nothing, and detections of another package."""

import json
import math
import re
import xml.etree.ElementTree as ElementTree
from base64 import b64decode
from dataclasses import replace
from html.parser import HTMLParser
from itertools import combinations
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from support.steps import Steps

from edgemap.geometry.errors import MapError
from edgemap.geometry.grid.occupancy_grid import OccupancyGrid
from edgemap.geometry.map_object import CHI2_95, MapObject
from edgemap.geometry.objects.annotations import Zone
from edgemap.geometry.observations.detections import Detections
from edgemap.geometry.se2 import SE2
from edgemap.runtime.frames.colours import MARKS, SHAPES, label_mark
from edgemap.runtime.outputs.map_formats.drawing import TITLE_PX, DrawnMap, _ellipse, _panels, _sheet, draw_map, map_svg
from edgemap.runtime.outputs.map_formats.shapes import PNG_SCALE, Raster, Shape, Text, bgr, picture_of, place_labels
from edgemap.runtime.outputs.map_objects import MapObjects
from edgemap.runtime.outputs.sightings_file import SeenRecord
from edgemap.runtime.step import overlay
from edgemap.runtime.step.overlay import draw_detections

SVG = "{http://www.w3.org/2000/svg}"


def item(identity, x, y, covariance: Any = 0.01, name=""):
    label = identity.rpartition("-")[0]
    matrix = np.array(covariance) if np.ndim(covariance) else covariance * np.eye(2)
    return MapObject(identity, label, np.array([x, y], float), matrix, 0.5, 0.9, 9, 0.9, 0.0, 1.0, name=name)


FULL = DrawnMap(
    [item("chair-1", 2, 0), item("bed-1", 0, 2), item("vase-1", 1, 1, 1.0)],
    (SE2(), SE2(0.5, 0, 0)),
    [SeenRecord("chair", (2.1, 0.0), "chair-1"), SeenRecord("tv", (1.0, 1.0))],
    [("bed", 0.0, 2.2)],
    (Zone("zone-1", "kitchen", ((0.0, 0.0), (1.0, 0.0), (1.0, 1.0))),),
    OccupancyGrid(np.full((40, 60), -40, np.int8), -1.0, -1.0, 0.05),
)


def texts(drawn):
    return [part.text or "" for part in ElementTree.fromstring(map_svg(drawn)).iter(f"{SVG}text")]


def test_forward_is_up_and_left_is_left_and_the_picture_shows_it_there(tmp_path):
    """An object 2 m ahead and one 2 m to the left: the first is drawn above the origin, the second left of it."""
    drawn = DrawnMap(FULL.objects[:2])
    sheet = _sheet(drawn)
    origin, ahead, left = (sheet.at(place) for place in ([0, 0], [2, 0], [0, 2]))
    assert origin - ahead == pytest.approx([0.0, 2.0 * sheet.px_per_m])
    assert origin - left == pytest.approx([2.0 * sheet.px_per_m, 0.0])
    picture = cv2.imread(str(draw_map(tmp_path / "made" / "map.png", drawn)))
    for at, colour in ((ahead, "#0072b2"), (left, "#c77700")):
        right, down = (PNG_SCALE * (at + (0.0, TITLE_PX))).round().astype(int)
        assert tuple(picture[down, right].tolist()) in (bgr(colour), (255, 255, 255)) or picture[down, right].std() > 20


def test_a_run_has_three_panels_and_a_map_alone_has_one():
    assert {
        "(a) all 2 sightings", "(b) 3 clusters", "(c) 3 objects with 95 % ellipses, 1 doubtful (hollow)", "kitchen",
        "chair-1",
    } <= set(texts(FULL))  # fmt: skip
    alone = DrawnMap(FULL.objects, FULL.poses)
    assert not [text for text in texts(alone) if text.startswith("(")]
    assert _panels(FULL)[1] > 2.8 * _panels(alone)[1]
    assert "no objects" in texts(DrawnMap([]))


@pytest.mark.parametrize("drawn", [FULL, DrawnMap([]), DrawnMap([item("chair-1", 40, -3, 9.0)], FULL.poses)])
def test_all_that_is_drawn_lies_on_the_sheet(drawn):
    items, width, height = _panels(drawn)
    for one in items:
        if isinstance(one, Shape) and one.closed:
            assert (one.points >= -1).all()
            assert (one.points <= (width + 1, height + 1)).all()
        elif isinstance(one, Text):
            assert 0 <= one.x <= width
            assert 0 <= one.y <= height


def test_doubtful_objects_are_hollow_and_the_ellipse_lies_along_its_uncertainty():
    # The vase's position is known to a metre.
    shapes = [one for one in _panels(DrawnMap(FULL.objects))[0] if isinstance(one, Shape)]
    assert [shape for shape in shapes if len(shape.points) == 48] != []
    assert len([shape for shape in shapes if len(shape.points) == 48]) == 2  # ellipses
    assert len([shape for shape in shapes if shape.fill == "#ffffff"]) == 1
    # Long along x + y (ahead and to the left): in the drawing that runs from lower right to upper left.
    along = np.array([1.0, 1.0]) / math.sqrt(2)
    points = _ellipse(item("a-1", 0, 0, 0.04 * np.outer(along, along) + 0.0001 * np.eye(2)))
    longest = points[np.argmax(np.linalg.norm(points, axis=1))]
    assert np.linalg.norm(longest) == pytest.approx(math.sqrt(CHI2_95 * 0.0401), rel=0.01)
    assert longest[0] == pytest.approx(longest[1], rel=0.05)


def test_names_of_objects_that_stand_close_do_not_cover_each_other():
    marks = [("chair-1", 100.0, 100.0), ("dining table-2", 104.0, 103.0), ("chair-3", 98.0, 108.0), ("vase-1", 99, 99)]
    boxes = []
    for (text, *_), (x, y, anchor) in zip(marks, place_labels(marks, 400, 300), strict=True):
        wide = 6.5 * len(text)
        left = x - {"start": 0.0, "middle": 0.5, "end": 1.0}[anchor] * wide
        boxes.append((left, y - 9, left + wide, y))
    assert not [
        1 for a, b in combinations(boxes, 2)
        if min(a[2], b[2]) - max(a[0], b[0]) > 1 and min(a[3], b[3]) - max(a[1], b[1]) > 1
    ]  # fmt: skip


def test_names_are_text_whatever_they_hold_and_what_cannot_be_drawn_is_one_line(tmp_path):
    hostile = '</text><script>x</script> & "q" \u202e\ud800'
    drawn = DrawnMap([item("chair-1", 1, 0, name=hostile)])
    tree = ElementTree.fromstring(map_svg(drawn))
    assert {part.tag for part in tree.iter()} == {f"{SVG}{tag}" for tag in ("svg", "style", "rect", "path", "text")}
    assert any('</text><script>x</script> & "q"' in (text or "") for text in texts(drawn))
    with pytest.raises(MapError, match=r"pictures are \.png or \.svg"):
        draw_map(tmp_path / "map.jpg", FULL)
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(MapError, match="cannot be"):
        draw_map(tmp_path / "file" / "map.png", FULL)


def test_a_picture_is_laid_where_it_belongs_and_cut_at_the_border():
    pixels = np.zeros((2, 2, 4), np.uint8)
    pixels[0, 0], pixels[1, 1] = (0, 0, 255, 255), (255, 0, 0, 128)
    image = picture_of([Raster(pixels, -4.0, 2.0, 12.0, 8.0)], 10, 10)
    assert image[5, 1].tolist() == [0, 0, 255]
    assert image[15, 10].tolist() == [255, 127, 127]
    assert image[5, 10].tolist() == [255, 255, 255]


# Machado, Oliveira and Fernandes 2009, severity 1, on linear RGB.
EYES = {
    "usual": np.eye(3),
    "protan": [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]],
    "deutan": [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.011820, 0.042940, 0.968881]],
    "tritan": [[1.255528, -0.076749, -0.178779], [-0.078411, 0.930809, 0.147602], [0.004733, 0.691367, 0.303900]],
}
APART = 25.0  # CIE 1976 colour difference; 2.3 is just noticeable side by side
MODELS = Path(__file__).parents[3] / "models"


def linear(colour):
    """sRGB `#rrggbb` to linear light, (3,)."""
    v = np.array([int(colour[i : i + 2], 16) for i in (1, 3, 5)]) / 255
    return np.where(v <= 0.04045, v / 12.92, ((v + 0.055) / 1.055) ** 2.4)


def luminance(colour):
    return float(linear(colour) @ [0.2126, 0.7152, 0.0722])


def difference(one, other, eye):
    lights = np.float32([[np.clip(np.array(EYES[eye]) @ linear(colour), 0, 1) for colour in (one, other)]])
    first, second = cv2.cvtColor(lights, cv2.COLOR_LRGB2Lab)[0]
    return float(np.linalg.norm(first - second))


@pytest.mark.parametrize("colour", sorted({mark.colour for mark in MARKS}))
@pytest.mark.parametrize("ground", ["#ffffff", "#1b1f25"])
def test_every_mark_has_3_to_1_contrast_on_both_pages(colour, ground):
    """WCAG 2.2, 1.4.11: white paper and light cards, dark cards."""
    low, high = sorted((luminance(colour), luminance(ground)))
    assert (high + 0.05) / (low + 0.05) >= 3.0


@pytest.mark.parametrize("eye", EYES)
def test_any_two_marks_differ_by_shape_or_by_a_colour_that_this_eye_tells(eye):
    assert len(set(MARKS)) == len(MARKS) == 3 * len(SHAPES)
    for one, other in combinations(MARKS, 2):
        assert one.shape != other.shape or difference(one.colour, other.colour, eye) >= APART, (one, other)


@pytest.mark.parametrize("bundle", sorted(path.parent.name for path in MODELS.glob("*/bundle.json")))
def test_all_that_a_bundle_maps_has_a_mark_of_its_own(bundle):
    classes = json.loads((MODELS / bundle / "bundle.json").read_text())["detector"]["classes"]
    mapped = [item["name"] for item in classes if item["mapped"]]
    assert mapped
    assert len({label_mark(name) for name in mapped}) == len(mapped)


def last_step():
    """Result and objects."""
    steps = Steps()
    return [steps.next() for _ in range(12)][-1]


def test_a_result_is_its_picture_with_boxes():
    result, _ = last_step()
    shown = cv2.imdecode(np.frombuffer(result._repr_png_(), np.uint8), cv2.IMREAD_COLOR)
    changed = (shown != result.frame.image).any(axis=2)
    assert changed[60:161, 40].mean() > 0.9  # the left side of the chair's box
    assert not changed[200:, :260].any()  # nothing is drawn where there is no box
    plain = cv2.imdecode(np.frombuffer(result.frame._repr_png_(), np.uint8), cv2.IMREAD_COLOR)
    np.testing.assert_array_equal(plain, result.frame.image)


def test_a_map_is_a_drawing_that_stands_alone_over_a_table():
    result, objects = last_step()
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
    assert "map of 0 objects" in MapObjects()._repr_html_()


BOXES = np.array([[1.0, 2, 30, 40], [5, 6, 70, 80]])
FOUND = Detections(BOXES, np.array([0.75, 0.5]), np.array([2, 0]), ("bed", "cat", "chair"))


def test_detections_go_to_supervision():
    supervision = pytest.importorskip("supervision")
    result, _ = last_step()
    theirs = replace(result, observed=replace(result.observed, detections=FOUND)).to_supervision()
    assert isinstance(theirs, supervision.Detections)
    assert theirs.area.tolist() == [29 * 38, 65 * 74]
    assert list(theirs.data["class_name"]) == ["chair", "bed"]


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
    found = Detections(boxes, np.full(3, 0.9), np.arange(3), ("chair", "bed", "tv"))
    draw_detections(np.zeros((480, 640, 3), np.uint8), found, [])
    assert len(plates) == 3
    assert not [pair for pair in combinations(plates, 2) if overlap(*pair)]
