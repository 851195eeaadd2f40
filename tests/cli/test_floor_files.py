"""The floor of a saved map as a user gets it: grid.npz beside map.json, Nav2's picture, GeoJSON's walls, drawings."""

import json

import numpy as np
import pytest
from support.boxed_room import floor_mask, walls
from support.rooms import mapped

from edgemap.geometry.camera.floor import FloorCamera
from edgemap.geometry.grid.fusion import GridFusion
from edgemap.geometry.grid.occupancy_grid import OccupancyGrid
from edgemap.geometry.se2 import SE2
from edgemap.runtime.step.grid_file import load_grid, save_grid
from edgemap.runtime.step.map_file import save_map

ROOM = walls(-1.0, -2.0, 4.0, 2.0)


@pytest.fixture(scope="module")
def grid() -> OccupancyGrid:
    """A room of 5 x 4 m, seen from its middle."""
    from support.boxed_room import CAMERA

    fusion = GridFusion()
    for index in range(60):
        pose = SE2(0.5 + 0.5 * np.cos(index / 9), 0.0, index / 9)
        fusion.observe(
            pose, index / 10, FloorCamera(CAMERA.intrinsics, CAMERA.mount), floor_mask(ROOM, pose), np.zeros((0, 4))
        )
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
    assert back is not None
    assert (back.log_odds == grid.log_odds).all()
    assert (back.x_m, back.y_m, back.cell_m) == pytest.approx((grid.x_m, grid.y_m, grid.cell_m))
    save_grid(folder / "grid.npz", OccupancyGrid(-grid.log_odds, grid.x_m, grid.y_m, grid.cell_m))
    cut = load_grid(folder)  # power went between the two files: the grid is still the map's own
    assert cut is not None
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


def test_geojson_has_the_walls_as_lines(edgemap, folder):
    assert edgemap("map", "export", folder, "--format", "geojson").returncode == 0
    features = json.loads((folder / "map.geojson").read_text())["features"]
    lines = [item for item in features if item["properties"].get("wall")]
    assert len(lines) == len(json.loads((folder / "map.json").read_text())["walls"])
    assert all(item["geometry"]["type"] == "LineString" for item in lines)


def test_merged_maps_keep_the_floor_of_both(edgemap, tmp_path, grid):
    rng = np.random.default_rng(3)
    things = mapped(
        [(label, *rng.uniform(-1, 4, 2)) for label in ("chair", "couch", "tv", "vase", "bed", "sink", "oven")]
    )
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        save_map(tmp_path / name / "map.json", things, grid=grid if name == "b" else None)
    done = edgemap("map", "merge", tmp_path / "a", tmp_path / "b", "-o", tmp_path / "both")
    assert done.returncode == 0, done.stderr
    both = load_grid(tmp_path / "both")
    assert both is not None
    assert both.area_m2(0) == pytest.approx(grid.area_m2(0), rel=0.05)


def test_a_map_copied_without_its_grid_loads_and_says_so(edgemap, folder):
    (folder / "grid.npz").unlink()
    done = edgemap("map", "export", folder, "--format", "nav2")
    assert done.returncode == 0
    assert "grid.npz is not beside it" in done.stderr


def test_an_older_map_has_no_grid(edgemap, tmp_path):
    save_map(tmp_path / "map.json", mapped([("chair", 2.0, 0.0)]))
    assert "grid" not in json.loads((tmp_path / "map.json").read_text())
    assert load_grid(tmp_path) is None
    done = edgemap("map", "export", tmp_path, "--format", "nav2")
    assert (done.returncode, done.stderr) == (0, "")
