import csv
import io
import json
import resource
import time
from dataclasses import replace

import numpy as np
import pytest
from support.rooms import mapped

from edgemap.geometry.errors import MapError
from edgemap.geometry.objects.annotations import Annotations, Zone
from edgemap.geometry.registration.alignment import AlignmentError, align
from edgemap.geometry.se2 import SE2
from edgemap.runtime.frames.errors import OdometryError
from edgemap.runtime.frames.trajectory import Trajectory, trajectory_of, tum_line
from edgemap.runtime.outputs.map_formats.drawing import DrawnMap, draw_map
from edgemap.runtime.outputs.map_formats.geojson import geojson_text
from edgemap.runtime.outputs.map_formats.grid import MAXIMUM_CELLS, CellsRule, grid_of
from edgemap.runtime.outputs.map_formats.nav2 import MAXIMUM_SHAPES, vector_text
from edgemap.runtime.outputs.map_formats.shapes import place_labels
from edgemap.runtime.outputs.map_formats.table import csv_text
from edgemap.runtime.step.map_file import map_document, read_map
from edgemap.view.report.document import MAXIMUM_OBJECTS, ReportContent, report_document
from edgemap.view.report.history import History
from edgemap.view.report.page import report_page

ROOM = mapped([("chair", 1.0, -2.0), ("potted plant", 0.5, 3.0)])


def signed_area(ring):
    x, y = np.array(ring).T
    return 0.5 * float(np.sum(x[:-1] * y[1:] - x[1:] * y[:-1]))


def test_geojson_says_its_frame_and_keeps_x_first():
    document = json.loads(geojson_text(ROOM))
    assert document["type"] == "FeatureCollection"
    assert "local frame map, metres, REP-103" in document["name"]
    assert "NOT WGS 84" in document["frame"]
    assert document["crs"] is None
    for feature, item in zip(document["features"], ROOM, strict=True):
        (ring,) = feature["geometry"]["coordinates"]
        assert (feature["type"], feature["id"], feature["geometry"]["type"]) == ("Feature", item.id, "Polygon")
        assert ring[0] == ring[-1]
        assert np.mean(ring[:-1], axis=0) == pytest.approx(item.position_m, abs=1e-3)
        side_m = {"chair": 0.5, "potted plant": 0.4}[item.label]
        assert signed_area(ring) == pytest.approx(side_m**2, rel=0.01)  # positive: counter-clockwise, RFC 7946
        assert feature["properties"]["label"] == item.label
        assert feature["properties"]["covariance_m2"] == item.covariance_m2.tolist()


@pytest.mark.parametrize("corners", [((0.0, 0.0), (2.0, 0.0), (2.0, 1.0)), ((0.0, 0.0), (2.0, 1.0), (2.0, 0.0))])
def test_zones_are_polygons_that_run_counter_clockwise(corners):
    (feature,) = json.loads(geojson_text([], annotations=Annotations((Zone("zone-1", "hall", corners),))))["features"]
    (ring,) = feature["geometry"]["coordinates"]
    assert signed_area(ring) == pytest.approx(1.0)
    assert (feature["id"], feature["properties"]["zone"]) == ("zone-1", "hall")


@pytest.mark.parametrize(("end", "kind"), [(2.0, "LineString"), (0.01, "Point")])
def test_the_way_is_a_line_or_a_standing_point(end, kind):
    way = Trajectory(np.array([0.0, 1.0, 2.0]), (SE2(), SE2(end / 2, 0.0), SE2(end, 0.0)))
    feature = json.loads(geojson_text([], way))["features"][-1]
    assert feature["geometry"]["type"] == kind
    if kind == "LineString":
        assert feature["geometry"]["coordinates"] == [[0, 0], [1, 0], [2, 0]]


def test_csv_is_one_line_per_object_with_its_name_and_zones():
    rows = list(csv.DictReader(csv_text(ROOM).splitlines()))
    assert [row["id"] for row in rows] == ["chair-1", "potted plant-1"]
    assert (float(rows[0]["x_m"]), float(rows[0]["y_m"])) == (1.0, -2.0)
    assert float(rows[0]["covariance_xx_m2"]) == pytest.approx(0.0144)
    assert float(rows[1]["radius_m"]) == pytest.approx(0.2257, abs=1e-4)
    square = ((0.0, -3.0), (2.0, -3.0), (2.0, 1.0), (0.0, 1.0))
    zones = [Zone("zone-1", "hall", square), Zone("zone-2", "=now()", square)]
    named = [replace(ROOM[0], name="my chair", confirmed=True), *ROOM[1:]]
    chair, plant = csv.DictReader(io.StringIO(csv_text(named, zones)))
    assert (chair["name"], chair["confirmed"], plant["name"]) == ("my chair", "True", "")
    assert (chair["zones"], plant["zones"]) == ("hall; =now()", "")


def test_the_way_is_read_up_to_a_torn_line(tmp_path):
    assert trajectory_of(tmp_path) is None
    lines = tum_line(0.0, SE2()) + tum_line(0.1, SE2(1.0, 0.0))
    (tmp_path / "trajectory.tum").write_text(lines + "0.2 2.0 0.0")
    (tmp_path / "map.json").write_text("{}")
    for path in (tmp_path, tmp_path / "map.json"):
        way = trajectory_of(path)
        assert [pose.x_m for pose in way.poses] == [0.0, 1.0]
    (tmp_path / "trajectory.tum").write_text("0.2 2.0")
    assert trajectory_of(tmp_path) is None
    (tmp_path / "trajectory.tum").write_text("0.2 2.0\n")
    with pytest.raises(OdometryError, match="expected 8 finite numbers"):
        trajectory_of(tmp_path)


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
