"""`map export`, `merge`, `show`, `approach` and `scale` as a user calls them, and the floor of a saved map."""

import json
import math
from dataclasses import replace

import cv2
import numpy as np
import pytest
from support.boxed_room import CAMERA, area_m2, floor_mask, walls
from support.refusal import one_line
from support.rooms import furnished, mapped

from edgemap.geometry.camera.floor import FloorCamera
from edgemap.geometry.grid.fusion import GridFusion
from edgemap.geometry.grid.occupancy_grid import FREE, OCCUPIED, OccupancyGrid
from edgemap.geometry.map_object import MapEvent, MapObject
from edgemap.geometry.objects.annotations import NO_ANNOTATIONS, Annotations, MapIdentity, Zone
from edgemap.geometry.se2 import SE2
from edgemap.runtime.frames.trajectory import trajectory_of, tum_line
from edgemap.runtime.step.grid_file import load_grid, save_grid
from edgemap.runtime.step.map_file import load_annotated_map, save_map

ROOM = [("chair", 1.0, 0.0), ("couch", 3.0, 2.0)]


def floor():
    """Free from (0, 0) to (2, 1) m, with one wall of cells along x = 2 m."""
    log_odds = np.full((20, 41), -32, np.int8)
    log_odds[:, 40] = 32
    return OccupancyGrid(log_odds, 0.0, 0.0, 0.05)


@pytest.fixture
def guessed_run(tmp_path):
    folder = tmp_path / "run"
    folder.mkdir()
    zone = Zone("zone-1", "kitchen", ((0.0, 0.0), (1.0, 0.0), (1.0, 1.0)))
    save_map(folder / "map.json", mapped(ROOM), Annotations((zone,), (), SE2(1.0, 2.0, 0.5)), floor())
    (folder / "trajectory.tum").write_text("".join(tum_line(k / 10, SE2(k / 10, 0.0, 0.3)) for k in range(20)))
    record = {"mount": {"height_m": 0.75}, "odometry": "hybrid", "quality": {"wheel_frames": 0}}
    (folder / "run.json").write_text(json.dumps(record))
    return folder


def test_exports_land_beside_the_map_in_a_file_or_in_a_folder(edgemap, guessed_run, tmp_path):
    expected = {
        "geojson": "map.geojson", "nav2": "map.yaml", "nav2-vector": "vector_objects.yaml", "csv": "map.csv",
        "svg": "map.svg",
    }  # fmt: skip
    for kind, name in expected.items():
        done = edgemap.ok("map", "export", guessed_run, "--format", kind)
        assert str(guessed_run / name) in done.stdout
        assert (guessed_run / name).stat().st_size > 0
    assert (guessed_run / "map.pgm").read_bytes().startswith(b"P5\n")
    assert json.loads((guessed_run / "map.geojson").read_text())["features"][-1]["id"] == "trajectory"
    assert edgemap("map", "export", guessed_run, "--format", "nav2", "-o", tmp_path / "a" / "flat.pgm").returncode == 0
    assert "image: flat.pgm" in (tmp_path / "a" / "flat.yaml").read_text()
    assert edgemap("map", "export", guessed_run / "map.json", "--format", "csv", "-o", tmp_path / "b").returncode == 0
    assert (tmp_path / "b" / "map.csv").is_file()


def test_two_drives_of_one_room_become_one_map(edgemap, tmp_path, grid):
    random = np.random.default_rng(3)
    room = furnished(random, 14)
    first, second = mapped(room[:12]), mapped(room[2:], SE2(4.0, -1.0, 2.5))
    first[0] = replace(first[0], name="mine", confirmed=True)
    zone = Zone("zone-1", "hall", ((0.0, 0.0), (1.0, 0.0), (1.0, 1.0)))
    save_map(tmp_path / "a.json", first, Annotations((zone,)))
    there = SE2(4.0, -1.0, 2.5).inverse().apply(np.array(zone.corners_m))
    there = replace(zone, corners_m=tuple(map(tuple, there.tolist())))
    save_map(tmp_path / "b.json", second, Annotations((there,)), grid)
    done = edgemap.ok("map", "merge", tmp_path / "a.json", tmp_path / "b.json", "-o", tmp_path / "merged")
    assert "10 of " in done.stdout
    assert "yaw 143.2 deg" in done.stdout
    merged, annotations = load_annotated_map(tmp_path / "merged")
    assert [item.id for item in merged if item.name == "mine" and item.confirmed] == [first[0].id]
    assert [zone.id for zone in annotations.zones] == ["zone-1", "zone-2"]
    np.testing.assert_allclose(annotations.zones[1].corners_m, zone.corners_m, atol=1e-3)
    assert len(merged) == 14
    assert {item.id for item in first} <= {item.id for item in merged}
    for label, x, y in room:
        assert any(item.label == label and np.allclose(item.position_m, [x, y], atol=1e-4) for item in merged)
    assert area_m2(load_grid(tmp_path / "merged"), FREE) == pytest.approx(area_m2(grid, FREE), rel=0.05)


def test_maps_that_do_not_fit_are_refused_with_numbers(edgemap, tmp_path):
    save_map(tmp_path / "a.json", mapped([("chair", x, y) for x in (0.0, 2.0) for y in (0.0, 3.0)]))
    twice = edgemap("map", "merge", tmp_path / "a.json", tmp_path / "a.json", "-o", tmp_path / "m.json")
    assert "does not fit" in one_line(twice)
    assert not (tmp_path / "m.json").exists()


@pytest.fixture
def room(tmp_path):
    def item(identity, x, y, last_s):
        label = identity.rpartition("-")[0]
        return MapObject(identity, label, np.array([x, y]), np.eye(2) * 0.01, 0.5, 0.9, 9, 0.9, 0.0, last_s)

    objects = [item("chair-1", 3.0, 0.0, 5.0), item("chair-2", -1.0, 0.5, 9.0), item("couch-1", 1.0, 1.0, 7.0)]
    save_map(tmp_path / "room.json", objects)
    return tmp_path / "room.json"


@pytest.mark.parametrize(
    ("question", "expected"),
    [
        (("--label", "chair", "--near", "-2,0.5"), [("chair-2", 1.0), ("chair-1", 5.024938)]),
        (("--near", "0,0"), [("chair-2", 1.118034), ("couch-1", 1.414214), ("chair-1", 3.0)]),
        (("--inside", "0,-1;4,-1;4,2;0,2"), [("chair-1", None), ("couch-1", None)]),
        (("--inside=-2,0;2,0;2,2;-2,2", "--since", "8"), [("chair-2", None)]),
        (("--label", "couch,bed"), [("couch-1", None)]),
        (("--label", "bed"), []),
        ((), [("chair-1", None), ("chair-2", None), ("couch-1", None)]),
    ],
)
def test_answers_as_one_json_document(edgemap, room, question, expected):
    result = edgemap.ok("map", "show", room, *question, "--json")
    document = json.loads(result.stdout)
    assert document["format"] == "edgemap.map/1"
    assert [(item["id"], item.get("distance_m")) for item in document["objects"]] == expected
    assert not room.with_suffix(".png").exists()


def test_answers_as_text_draw_only_on_request(edgemap, room, tmp_path):
    result = edgemap("map", "show", room, "--label", "chair", "--near", "3,0")
    lines = result.stdout.splitlines()
    assert lines[0].startswith("chair-1")
    assert lines[0].endswith("0.00 m away")
    assert lines[-1] == "2 of 3 objects"
    assert not room.with_suffix(".png").exists()
    result = edgemap("map", "show", room, "--label", "chair", "-o", tmp_path / "some.png")
    assert "2 of 3 objects; drawn in" in result.stdout
    assert cv2.imread(str(tmp_path / "some.png")) is not None


def test_the_history_and_the_verdict_of_any_map(edgemap, tmp_path):
    moved = MapEvent("moved", 1.8e9, from_m=(1.0, 2.0), to_m=(3.0, -1.0), other="chair-1")
    bag = MapObject("chair-2", "chair", np.zeros(2), np.eye(2), 0.5, 0.9, 9, 0.9, 0.0, 1.0, history=(moved,))
    notes = Annotations(identity=MapIdentity("home", 2, level="care", reasons=("dim light",)))
    save_map(tmp_path / "map.json", [bag], notes)
    line = edgemap("map", "show", tmp_path, "--history").stdout
    assert line == "2027-01-15T08:00:00Z  chair-2  moved  (chair-1)  from x 1.00 y 2.00 m  to x 3.00 y -1.00 m\n"
    (change,) = json.loads(edgemap("map", "show", tmp_path, "--history", "--json").stdout)["changes"]
    assert (change["id"], change["what"], change["other"]) == ("chair-2", "moved", "chair-1")
    lines = edgemap("why", tmp_path).stdout.splitlines()
    assert lines[0].startswith(f"{tmp_path}: map: use with care")
    assert "dim light" in lines[1]


NEAR = ("--label", "chair", "--near", "2,3")


@pytest.mark.parametrize(("asked", "number"), [(("chair-2",), 2), (("blue chair",), 1), (NEAR, 2), (NEAR[:2], 1)])
def test_a_pose_before_an_object(edgemap, tmp_path, asked, number):
    near, far = mapped([("chair", 2.0, 0.0), ("chair", 2.0, 2.0)])
    free = OccupancyGrid(np.full((200, 200), -100, np.int8), -5.0, -5.0, 0.05)
    save_map(tmp_path / "map.json", [replace(near, name="blue chair"), far], NO_ANNOTATIONS, free)
    done = edgemap.ok("map", "approach", tmp_path, *asked, "--json")
    document = json.loads(done.stdout)
    assert (document["object"], document["frame"], document["floor"]) == (f"chair-{number}", "map", "free")
    assert document["standoff_m"] == 0.4
    done = edgemap("map", "approach", tmp_path, "chair-1", "--near", "0,0")
    assert done.stdout.startswith("chair-1: x 1.")
    assert "yaw 0.0 deg; 0.40 m before it, free floor" in done.stdout
    done = edgemap("map", "export", tmp_path, "--format", "nav2", "--resolution", "0.1")
    assert (done.returncode, "cells of 0.05 m" in done.stderr) == (2, True)
    save_map(tmp_path / "map.json", [replace(one, name="blue chair") for one in (near, far)])
    done = edgemap("map", "approach", tmp_path, "blue chair")
    assert "'blue chair' is the name of chair-1 and chair-2: give an id" in done.stderr


def test_the_height_by_tape_scales_all_lengths(edgemap, guessed_run, tmp_path):
    done = edgemap.ok("map", "scale", guessed_run, "--height", "0.60", "-o", tmp_path / "scaled")
    assert "map of 2 objects, 0.800 times as large" in done.stdout
    objects, annotations = load_annotated_map(tmp_path / "scaled")
    before = mapped(ROOM)
    for old, new in zip(before, objects, strict=True):
        assert new.position_m == pytest.approx(0.8 * old.position_m)
        assert new.covariance_m2 == pytest.approx(0.64 * old.covariance_m2, abs=1e-8)
        assert (new.width_m, new.count) == (pytest.approx(0.8 * old.width_m, abs=1e-4), old.count)
    assert annotations.zones[0].corners_m[1] == (0.8, 0.0)
    assert annotations.dock == SE2(0.8, 1.6, 0.5)
    trajectory = trajectory_of(tmp_path / "scaled")
    assert (trajectory.poses[10].x_m, trajectory.poses[10].yaw_rad) == (pytest.approx(0.8), pytest.approx(0.3))
    grid = load_grid(tmp_path / "scaled")
    assert grid.cell_m == 0.05
    assert grid.at([(0.02, 0.02), (1.57, 0.77), (1.62, 0.4)]).tolist() == [FREE, FREE, OCCUPIED]
    assert area_m2(grid, FREE) == pytest.approx(0.64 * area_m2(floor(), FREE), rel=0.05)


def test_a_distance_between_two_objects_scales_it_too(edgemap, guessed_run, tmp_path):
    length_m = 1.5 * math.hypot(2.0, 2.0)
    between = ("--between", f"chair-1,couch-1,{length_m}")
    edgemap.ok("map", "scale", guessed_run / "map.json", *between, "-o", tmp_path / "scaled")
    objects, _ = load_annotated_map(tmp_path / "scaled")
    assert math.dist(objects[0].position_m, objects[1].position_m) == pytest.approx(length_m)
    grid = load_grid(tmp_path / "scaled")
    assert area_m2(grid, FREE) == pytest.approx(2.25 * area_m2(floor(), FREE), rel=0.05)  # without holes
    assert OCCUPIED in grid.at([(3.02, 0.7)]).tolist()


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"quality": {"wheel_frames": 30}}, "wheels measured this run's path"),
        ({"attitude_sources": {"depth": 9}}, "depth measured this run's path"),
        ({"odometry": "truth"}, "truth measured this run's path"),
        ({"map": "kitchen", "start": None}, "a saved map, and the runs before it, measured this"),
    ],
)
def test_what_is_no_scale_is_one_line(edgemap, guessed_run, tmp_path, change, text):
    record = json.loads((guessed_run / "run.json").read_text()) | change
    (guessed_run / "run.json").write_text(json.dumps(record))
    assert text in one_line(edgemap("map", "scale", guessed_run, "--height", "0.6", "-o", tmp_path / "scaled"), 2)
    assert not (tmp_path / "scaled").exists()


@pytest.mark.parametrize("height", ["1" + "0" * 400, "[]", "null", '"x"'])
def test_a_damaged_run_json_is_one_line(edgemap, guessed_run, tmp_path, height):
    record = guessed_run / "run.json"
    record.write_text(record.read_text().replace("0.75", height))
    done = edgemap("map", "scale", guessed_run, "--height", "0.6", "-o", tmp_path / "scaled")
    assert "run.json: it has no mount" in one_line(done)


WALLS = walls(-1.0, -2.0, 4.0, 2.0)


@pytest.fixture(scope="module")
def grid() -> OccupancyGrid:
    """A room of 5 x 4 m, seen from its middle."""
    fusion, camera, nobody = GridFusion(), FloorCamera(CAMERA.intrinsics, CAMERA.mount), np.zeros((0, 4))
    for index in range(60):
        pose = SE2(0.5 + 0.5 * np.cos(index / 9), 0.0, index / 9)
        fusion.observe(pose, index / 10, camera, floor_mask(WALLS, pose), nobody, nobody)
    found = fusion.grid()
    assert found is not None
    return found


@pytest.fixture
def folder(tmp_path, grid):
    save_map(tmp_path / "map.json", mapped([("chair", 2.0, 0.0)]), grid=grid)
    return tmp_path


def picture_of(folder):
    """Cells of the PGM, row 0 with the smallest y, and the corner in its YAML."""
    data = (folder / "map.pgm").read_bytes()
    size = data.split(b"\n")[2].split()
    columns, rows = int(size[0]), int(size[1])
    text = (folder / "map.yaml").read_text()
    x_m, y_m, _ = json.loads(text.split("origin: ")[1].split("\n")[0])
    return np.frombuffer(data[-rows * columns :], np.uint8).reshape(rows, columns)[::-1], x_m, y_m


def test_a_saved_grid_comes_back_as_it_was(folder, grid):
    document = json.loads((folder / "map.json").read_text())
    back = load_grid(folder)
    assert document["grid"] == "grid.npz"
    assert (back.log_odds == grid.log_odds).all()
    assert (back.x_m, back.y_m, back.cell_m) == pytest.approx((grid.x_m, grid.y_m, grid.cell_m))
    save_grid(folder / "grid.npz", OccupancyGrid(-grid.log_odds, grid.x_m, grid.y_m, grid.cell_m))
    cut = load_grid(folder)  # power went between the two files: the grid is still the map's own
    assert (cut.log_odds == grid.log_odds).all()
    save_map(folder / "map.json", [], grid=grid)
    assert sorted(path.name for path in folder.iterdir()) == ["grid.npz", "map.json"]
    sides = sorted(np.hypot(*np.subtract(wall["to_m"], wall["from_m"])) for wall in document["walls"])
    assert 3.5 < sides[-1] < 5.5  # a long wall, not in pieces
    assert len(sides) >= 3


def test_nav2_gets_the_floor_that_was_seen_and_objects_only_where_asked(edgemap, folder):
    assert edgemap("map", "export", folder, "--format", "nav2").returncode == 0
    cells, x_m, y_m = picture_of(folder)

    def at(x, y):
        return cells[int((y - y_m) / 0.05), int((x - x_m) / 0.05)]

    assert at(2.0, 0.0) == 254
    assert (cells == 0).any()
    assert edgemap("map", "export", folder, "--format", "nav2", "--objects").returncode == 0
    cells, x_m, y_m = picture_of(folder)
    assert at(2.0, 0.0) == 0
    assert at(0.5, 0.0) == 254
    (folder / "grid.npz").unlink()
    done = edgemap.ok("map", "export", folder, "--format", "nav2")
    assert "grid.npz is not beside it" in done.stderr


def test_geojson_has_the_walls_as_lines_and_an_older_map_has_no_grid(edgemap, folder, tmp_path):
    assert edgemap("map", "export", folder, "--format", "geojson").returncode == 0
    features = json.loads((folder / "map.geojson").read_text())["features"]
    lines = [item for item in features if item["properties"].get("wall")]
    assert len(lines) == len(json.loads((folder / "map.json").read_text())["walls"])
    assert all(item["geometry"]["type"] == "LineString" for item in lines)
    older = tmp_path / "older"
    older.mkdir()
    save_map(older / "map.json", mapped([("chair", 2.0, 0.0)]))
    assert "grid" not in json.loads((older / "map.json").read_text())
    assert load_grid(older) is None
    done = edgemap("map", "export", older, "--format", "nav2")
    assert (done.returncode, done.stderr) == (0, "")
