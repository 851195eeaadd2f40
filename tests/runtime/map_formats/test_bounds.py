"""Exporters count what they are to draw before they make it; objects and zones are two namespaces."""

import json
import resource
import time

import numpy as np
import pytest
from support.rooms import mapped

from edgemap.geometry.errors import MapError
from edgemap.geometry.objects.annotations import Annotations, Zone
from edgemap.geometry.registration.alignment import AlignmentError, align
from edgemap.geometry.se2 import SE2
from edgemap.runtime.frames.trajectory import Trajectory
from edgemap.runtime.outputs.map_formats.drawing import DrawnMap, draw_map
from edgemap.runtime.outputs.map_formats.geojson import geojson_text
from edgemap.runtime.outputs.map_formats.grid import MAXIMUM_CELLS, CellsRule, grid_of
from edgemap.runtime.outputs.map_formats.nav2 import MAXIMUM_SHAPES, vector_text
from edgemap.runtime.outputs.map_formats.shapes import place_labels
from edgemap.runtime.step.map_file import map_document, read_map
from edgemap.view.report.document import MAXIMUM_OBJECTS, ReportContent, report_document
from edgemap.view.report.history import History
from edgemap.view.report.page import report_page


@pytest.fixture(autouse=True)
def cheap():
    """No case takes 10 s of processor time, or a quarter of a gibibyte."""
    begun_s, before_kb = time.process_time(), resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    yield
    assert time.process_time() - begun_s < 10.0
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before_kb < 256 << 10


def path_of(*points):
    return Trajectory(np.arange(float(len(points))), tuple(SE2(x, y) for x, y in points))


def many(count):
    return mapped([("chair", float(k % 100), float(k // 100)) for k in range(count)])


@pytest.mark.parametrize(
    ("trajectory", "rule", "told"),
    [
        (path_of((0, 0), (1e6, 1e6), (-1e6, -1e6)), CellsRule(), f"cells of 0.05 m: more than {MAXIMUM_CELLS}"),
        (path_of((0, 0), (1, 1)), CellsRule(1e-12), "cells of 1e-12 m"),
    ],
)
def test_a_grid_is_counted_before_it_is_made(trajectory, rule, told):
    with pytest.raises(MapError, match=told):
        grid_of([], trajectory, rule)


def test_the_other_exporters_are_bounded_too(tmp_path):
    objects = many(MAXIMUM_SHAPES + 1)
    with pytest.raises(MapError, match=f"at most {MAXIMUM_SHAPES} are shapes"):
        vector_text(objects)
    with pytest.raises(MapError, match="5001 objects, at most 5000 are drawn"):
        draw_map(tmp_path / "map.svg", DrawnMap(objects))
    assert len(place_labels([("chair", float(k), 0.0) for k in range(20_000)], 900.0, 700.0)) == 20_000
    document = report_document(ReportContent({"marks": {}, "camera": "none"}, {}, objects, History()))
    assert (len(document["update"]["changed"]), document["run"]["objects"]) == (MAXIMUM_OBJECTS, len(objects))
    assert len(report_page(document)) < 4 << 20
    with pytest.raises(AlignmentError, match="too large to compare"):
        align(objects, objects)


def test_objects_and_zones_are_two_namespaces():
    """A bundle's class may be called zone; a zone's id is `zone-1`."""
    objects = mapped([("zone", 0.0, 0.0)])
    zones = (Zone("zone-1", "kitchen", ((0.0, 0.0), (1.0, 0.0), (1.0, 1.0))),)
    assert [item.id for item in objects] == ["zone-1"]
    read, annotations = read_map(json.dumps(map_document(objects, Annotations(zones))).encode(), "a map")
    assert (read[0].id, annotations.zones) == ("zone-1", zones)
    ids = [feature["id"] for feature in json.loads(geojson_text(objects, annotations=annotations))["features"]]
    assert ids == ["zone-1", "zone:zone-1"]
    with pytest.raises(MapError, match="two zones have the id 'zone-1'"):
        read_map(json.dumps(map_document([], Annotations(zones * 2))).encode(), "a map")
