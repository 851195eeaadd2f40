"""Maps as files of other programs: GeoJSON and CSV, bounded in size; Nav2's, read back by what its documentation
says."""

import csv
import io
import json
import resource
import time
import uuid
from dataclasses import replace

import numpy as np
import pytest
import yaml
from support.rooms import mapped, two_rooms

from edgemap.geometry.errors import MapError
from edgemap.geometry.grid.rooms import floor_parts
from edgemap.geometry.objects.annotations import Annotations, Zone
from edgemap.geometry.registration.alignment import AlignmentError, align
from edgemap.geometry.se2 import SE2
from edgemap.runtime.frames.errors import OdometryError
from edgemap.runtime.frames.trajectory import Trajectory, trajectory_of, tum_line
from edgemap.runtime.outputs.map_formats.drawing import DrawnMap, draw_map
from edgemap.runtime.outputs.map_formats.geojson import geojson_text
from edgemap.runtime.outputs.map_formats.grid import (
    FREE,
    MAXIMUM_CELLS,
    MAXIMUM_LIVE_CELLS,
    OCCUPIED,
    UNKNOWN,
    grid_of,
    live_grid,
)
from edgemap.runtime.outputs.map_formats.nav2 import MAXIMUM_SHAPES, vector_text, write_masks, write_nav2, write_picture
from edgemap.runtime.outputs.map_formats.route import route_text
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


@pytest.mark.parametrize(
    ("trajectory", "cell_m", "words"),
    [
        (path_of((0, 0), (1e6, 1e6), (-1e6, -1e6)), 0.05, f"cells of 0.05 m: more than {MAXIMUM_CELLS}"),
        (path_of((0, 0), (1, 1)), 1e-12, "cells of 1e-12 m"),
    ],
)
def test_a_grid_is_counted_before_it_is_made(trajectory, cell_m, words):
    with pytest.raises(MapError, match=words):
        grid_of([], trajectory, cell_m)


def test_the_other_exporters_are_bounded_too(tmp_path):
    objects = mapped([("chair", float(k % 100), float(k // 100)) for k in range(MAXIMUM_SHAPES + 1)])
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
    with pytest.raises(MapError, match="two zones have the id 'zone-1'"):
        read_map(json.dumps(map_document([], Annotations(zones * 2))).encode(), "a map")


# An L: three chairs along x, one to the left (+y) of the first. No mirror image or transpose of it is itself.
CROOKED = [("chair", 1.0, 0.0), ("chair", 3.0, 0.0), ("chair", 6.0, 0.0), ("chair", 1.0, 2.0)]


def read_back(path, mode, meaning):
    """What map_server answers for a point of a map in this mode: `meaning` of its pixel, None outside.

    Written from the documentation of map_server, not from our writer: origin is the pose of the lower left pixel.
    """
    described = yaml.safe_load(path.read_text())
    with (path.parent / described["image"]).open("rb") as stream:
        assert stream.readline() == b"P5\n"
        line = stream.readline()
        while line.startswith(b"#"):
            line = stream.readline()
        width, height = map(int, line.split())
        assert stream.readline() == b"255\n"
        pixels = np.frombuffer(stream.read(), np.uint8).reshape(height, width)[::-1]
    x0, y0, yaw = described["origin"]
    assert yaw == 0.0
    assert described["negate"] == 0
    assert described["mode"] == mode

    def value(x, y):
        column = int(np.floor((x - x0) / described["resolution"]))
        row = int(np.floor((y - y0) / described["resolution"]))
        if not (0 <= column < width and 0 <= row < height):
            return None
        return meaning(int(pixels[row, column]), described)

    return value


def served(path):
    """0 free, 100 occupied, -1 unknown: probability is (255 - pixel) / 255; above occupied_thresh occupied, below
    free_thresh free."""

    def meaning(pixel, described):
        occupancy = (255 - pixel) / 255.0
        if occupancy > described["occupied_thresh"]:
            return 100
        return 0 if occupancy < described["free_thresh"] else -1

    return read_back(path, "trinary", meaning)


def test_a_live_grid_is_bounded_however_far_objects_are():
    here = live_grid(mapped(CROOKED), -1.0, -1.0)
    row, column = int((2.0 - here.y_m) / 0.05), int((1.0 - here.x_m) / 0.05)
    assert here.cell_m == 0.05
    assert here.cells[row, column] == OCCUPIED
    assert here.cells[int((-1.0 - here.y_m) / 0.05), int((-1.0 - here.x_m) / 0.05)] == FREE
    far = live_grid(mapped([*CROOKED, ("chair", 1e6, -1e6)]), 0.0, 0.0)
    assert far.cells.size <= MAXIMUM_LIVE_CELLS
    assert np.count_nonzero(far.cells == OCCUPIED) >= 2
    assert live_grid([], 3.0, 4.0).cells.max() == FREE


def test_nothing_is_mirrored_or_transposed(tmp_path):
    way = path_of((-2.0, -1.0), (4.0, -1.0), (4.0, -3.0))
    write_nav2(tmp_path / "map.yaml", grid_of(mapped(CROOKED), way))
    value = served(tmp_path / "map.yaml")
    for _, x, y in CROOKED:
        for dx, dy in ((0, 0), (0.2, 0), (-0.2, 0), (0, 0.2), (0, -0.2)):  # a chair's circle is 0.28 m
            assert value(x + dx, y + dy) == 100
        for dx, dy in ((0.35, 0), (-0.35, 0), (0, 0.35), (0, -0.35)):
            assert value(x + dx, y + dy) == -1
    for x, y in ((3.0, 2.0), (6.0, 2.0), (1.0, -2.0), (2.0, 1.0), (0.0, 1.0), (0.0, 2.0)):  # mirror images, transposes
        assert value(x, y) == -1
    for x, y in ((-2.0, -1.0), (0.0, -1.12), (3.0, -0.88), (4.12, -2.0), (3.88, -3.0)):  # swept 0.35 m wide
        assert value(x, y) == 0
    for x, y in ((-2.0, 1.0), (0.0, -1.22), (-1.0, 0.0), (4.25, -2.0), (3.7, -2.0)):
        assert value(x, y) == -1
    assert value(20.0, 0.0) is None


@pytest.mark.parametrize("shift", [(0.0, 0.0), (-7.013, 3.021), (100.5, -200.25)])
def test_cells_lie_where_the_origin_says_to_half_a_cell(tmp_path, shift):
    room = mapped([("refrigerator", shift[0], shift[1])])  # radius 0.367 m
    write_nav2(tmp_path / "map.yaml", grid_of(room, cell_m=0.02))
    value = served(tmp_path / "map.yaml")
    edge = 0.65 / np.sqrt(np.pi)
    for turn in np.linspace(0, 2 * np.pi, 24):
        way = np.array([np.cos(turn), np.sin(turn)])
        assert value(*(np.array(shift) + (edge - 0.02) * way)) == 100
        assert value(*(np.array(shift) + (edge + 0.02) * way)) == -1


def test_an_object_on_the_way_stays_occupied_and_a_standing_robot_has_swept_its_own_circle():
    grid = grid_of(mapped([("chair", 1.0, 0.0)]), path_of((0.0, 0.0), (2.0, 0.0)))
    values, counts = np.unique(grid.cells, return_counts=True)
    assert values.tolist() == [UNKNOWN, FREE, OCCUPIED]
    assert counts[2] * 0.05**2 == pytest.approx(0.25, rel=0.05)  # a chair's 0.5 m by 0.5 m
    grid = grid_of([], path_of((0.0, 0.0), (0.0, 0.0)), 0.01, 1.0)
    assert (grid.cells == FREE).sum() * 0.01**2 == pytest.approx(np.pi / 4, rel=0.01)
    with pytest.raises(MapError, match="neither objects nor a trajectory"):
        grid_of([])
    with pytest.raises(MapError, match="coarser resolution"):
        grid_of(mapped([("chair", 0.0, 0.0), ("chair", 9000.0, 9000.0)]))


def test_vector_objects_are_what_the_server_reads():
    room = mapped([("potted plant", 1.0, -2.0), ("couch", 0.0, 3.5), ("couch", 4.0, 0.25)])
    parameters = yaml.safe_load(vector_text(room))["vector_object_server"]["ros__parameters"]
    assert parameters["shapes"] == ["potted_plant_1", "couch_1", "couch_2"]
    assert parameters["global_frame_id"] == "map"
    seen = set()
    for name, (x, y) in zip(parameters["shapes"], [(1.0, -2.0), (0.0, 3.5), (4.0, 0.25)], strict=True):
        shape = parameters[name]
        assert set(shape) == {"type", "uuid", "frame_id", "fill", "value", "center", "radius"}
        assert (shape["type"], shape["frame_id"], shape["value"], shape["fill"]) == ("circle", "map", 100, True)
        assert shape["center"] == [x, y]
        assert all(type(value) is float for value in [*shape["center"], shape["radius"]])  # rclcpp refuses integers
        seen.add(uuid.UUID(shape["uuid"]))
    assert len(seen) == 3
    assert all(one.version == 5 for one in seen)
    assert parameters["couch_1"]["radius"] == pytest.approx(0.7569, abs=1e-4)  # 2.0 m x 0.9 m as a circle


def test_uuids_stay_with_the_object_and_differ_between_places():
    def uuids(*arguments):
        parameters = yaml.safe_load(vector_text(*arguments))["vector_object_server"]["ros__parameters"]
        return [parameters[name]["uuid"] for name in parameters["shapes"]]

    before, grown = mapped([("chair", 0.0, 0.0)]), mapped([("chair", 0.3, 0.0), ("tv", 1.0, 1.0)])
    assert uuids(before) == uuids(grown)[:1] == ["4d806933-ffd4-5c29-9525-c43812182307"]
    assert set(uuids(before, "cellar")).isdisjoint(uuids(before))


HALL = Zone("zone-1", "hall", ((0.0, 0.0), (4.0, 0.0), (4.0, 2.0), (0.0, 2.0)))
STAIRS = Zone("zone-2", "stairs", ((3.0, 1.0), (5.0, 1.0), (5.0, 3.0)))


def masked(path):
    """The pixel's value."""
    return read_back(path, "raw", lambda pixel, _: pixel)


def test_zones_are_masks_of_nav2s_filters(tmp_path):
    keep, slow = write_masks(tmp_path / "zones.yaml", [HALL, STAIRS], ["stairs"], {"hall": 40, "zone-2": 20})
    assert (keep.name, slow.name) == ("zones.keepout.yaml", "zones.speed.yaml")
    value = masked(keep)
    assert [value(4.8, 1.5), value(3.2, 2.5), value(1.0, 1.0), value(2.1, 0.1)] == [100, 0, None, 0]
    value = masked(slow)
    assert [value(1.0, 1.0), value(3.8, 1.4), value(4.8, 1.5), value(-0.5, 1.0)] == [40, 20, 20, 0]  # the slower counts
    with pytest.raises(MapError, match="no zone 'cellar' on the map; it has hall, stairs"):
        write_masks(tmp_path / "zones.yaml", [HALL, STAIRS], ["cellar"], {})


def test_zones_are_polygons_of_the_vector_object_server():
    """As nav2_map_server's Polygon reads them: closed is filled, points are x, y in turn, floating-point."""
    document = yaml.safe_load(vector_text(mapped([("chair", 1.0, 1.0)]), zones=[HALL, STAIRS], keep_out=["stairs"]))
    parameters = document["vector_object_server"]["ros__parameters"]
    assert parameters["shapes"] == ["zone_1", "zone_2", "chair_1"]  # the objects lie over them
    assert (parameters["zone_1"]["closed"], parameters["zone_1"]["value"]) == (False, -1)
    assert (parameters["zone_2"]["closed"], parameters["zone_2"]["value"]) == (True, 100)
    assert parameters["zone_2"]["points"] == [3.0, 1.0, 5.0, 1.0, 5.0, 3.0]
    assert all(isinstance(value, float) for value in parameters["zone_1"]["points"])


@pytest.mark.parametrize("name", ["home #2", "a: b", "@home", "[1] hall", "*floor", "%tmp", "{x}", "- a", "Küche 'n'"])
def test_a_name_of_any_letters_is_the_picture_that_the_file_names(name, tmp_path):
    path = tmp_path / f"{name}.yaml"
    picture = write_picture(path, np.zeros((2, 3), np.uint8), "trinary", 0.05, (0.0, 0.0))
    assert (tmp_path / yaml.safe_load(path.read_text())["image"]).read_bytes() == picture.read_bytes()


def test_a_route_graph_leads_over_free_floor_from_room_to_room():
    grid = two_rooms(0.9)
    grid.log_odds[30:54, 80:84] = 40  # a cupboard before the door
    rooms, doors = floor_parts(grid)
    features = json.loads(route_text(rooms, doors, grid, 0.2))["features"]
    nodes = {one["properties"]["id"]: one for one in features if one["geometry"]["type"] == "Point"}
    edges = [one for one in features if one["geometry"]["type"] == "LineString"]
    assert len({one["properties"]["id"] for one in features}) == len(features)
    graph = {number: set() for number in nodes}
    for edge in edges:  # as nav2_route reads them
        a, b = (edge["properties"][end] for end in ("startid", "endid"))
        graph[a].add(b)
        ends = np.array([nodes[a]["geometry"]["coordinates"], nodes[b]["geometry"]["coordinates"]])
        assert edge["geometry"]["coordinates"] == ends.tolist()
        assert (grid.at(ends[0] + np.linspace(0.0, 1.0, 99)[:, None] * (ends[1] - ends[0])) == 0).all()
    reached, waiting = set(), [0]
    while waiting:
        reached.add(waiting.pop())
        waiting += [one for number in reached for one in graph[number] if one not in reached]
    assert reached == set(nodes)
    assert [one["properties"]["metadata"]["class"] for one in nodes.values()][:3] == ["room", "room", "door"]
    with pytest.raises(MapError, match="no door between two rooms"):
        route_text(rooms, [], grid, 0.2)
