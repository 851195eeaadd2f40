import csv
import io
import json
from dataclasses import replace

import numpy as np
import pytest
from support.rooms import mapped

from edgemap.geometry.objects.annotations import Annotations, Zone
from edgemap.geometry.se2 import SE2
from edgemap.runtime.frames.errors import OdometryError
from edgemap.runtime.frames.trajectory import Trajectory, trajectory_of, tum_line
from edgemap.runtime.outputs.map_formats.geojson import geojson_text
from edgemap.runtime.outputs.map_formats.table import csv_text

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


def test_csv_is_one_line_per_object():
    rows = list(csv.DictReader(csv_text(ROOM).splitlines()))
    assert [row["id"] for row in rows] == ["chair-1", "potted plant-1"]
    assert (float(rows[0]["x_m"]), float(rows[0]["y_m"])) == (1.0, -2.0)
    assert float(rows[0]["covariance_xx_m2"]) == pytest.approx(0.0144)
    assert float(rows[1]["radius_m"]) == pytest.approx(0.2257, abs=1e-4)


def test_the_way_is_read_up_to_a_torn_line(tmp_path):
    assert trajectory_of(tmp_path) is None
    lines = tum_line(0.0, SE2()) + tum_line(0.1, SE2(1.0, 0.0))
    (tmp_path / "trajectory.tum").write_text(lines + "0.2 2.0 0.0")
    (tmp_path / "map.json").write_text("{}")
    for path in (tmp_path, tmp_path / "map.json"):
        way = trajectory_of(path)
        assert way is not None
        assert [pose.x_m for pose in way.poses] == [0.0, 1.0]
    (tmp_path / "trajectory.tum").write_text("0.2 2.0")
    assert trajectory_of(tmp_path) is None
    (tmp_path / "trajectory.tum").write_text("0.2 2.0\n")
    with pytest.raises(OdometryError, match="expected 8 finite numbers"):
        trajectory_of(tmp_path)


def test_a_name_that_a_person_gave_is_a_column_of_every_line():
    named = [replace(ROOM[0], name="my chair", confirmed=True), *ROOM[1:]]
    rows = list(csv.DictReader(csv_text(named).splitlines()))
    assert [row["name"] for row in rows] == ["my chair"] + [""] * (len(ROOM) - 1)
    assert rows[0]["confirmed"] == "True"


def test_the_table_says_in_which_zones_an_object_is():
    square = ((0.0, -1.0), (2.0, -1.0), (2.0, 1.0), (0.0, 1.0))
    zones = [Zone("zone-1", "hall", square), Zone("zone-2", "=now()", square)]
    chair, bed = csv.DictReader(io.StringIO(csv_text(mapped([("chair", 1.0, 0.0), ("bed", 5.0, 0.0)]), zones)))
    assert (chair["zones"], bed["zones"]) == ("hall; =now()", "")
