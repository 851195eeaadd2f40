"""`map scale` as a user calls it: one measured length, and all lengths of the map follow."""

import json
import math

import numpy as np
import pytest
from support.refusal import one_line
from support.rooms import mapped

from edgemap.geometry.grid.occupancy_grid import FREE, OCCUPIED, OccupancyGrid
from edgemap.geometry.objects.annotations import Annotations, Zone
from edgemap.geometry.se2 import SE2
from edgemap.runtime.frames.trajectory import trajectory_of, tum_line
from edgemap.runtime.step.grid_file import load_grid
from edgemap.runtime.step.map_file import load_annotated_map, save_map

ROOM = [("chair", 1.0, 0.0), ("couch", 3.0, 2.0)]


def floor():
    """Free from (0, 0) to (2, 1) m, with one wall of cells along x = 2 m."""
    log_odds = np.full((20, 41), -32, np.int8)
    log_odds[:, 40] = 32
    return OccupancyGrid(log_odds, 0.0, 0.0, 0.05)


@pytest.fixture
def run_folder(tmp_path):
    folder = tmp_path / "run"
    folder.mkdir()
    zone = Zone("zone-1", "kitchen", ((0.0, 0.0), (1.0, 0.0), (1.0, 1.0)))
    save_map(folder / "map.json", mapped(ROOM), Annotations((zone,), (), SE2(1.0, 2.0, 0.5)), floor())
    (folder / "trajectory.tum").write_text("".join(tum_line(k / 10, SE2(k / 10, 0.0, 0.3)) for k in range(20)))
    record = {"mount": {"height_m": 0.75}, "odometry": "hybrid", "quality": {"wheel_frames": 0}}
    (folder / "run.json").write_text(json.dumps(record))
    return folder


def test_the_height_by_tape_scales_all_lengths(edgemap, run_folder, tmp_path):
    done = edgemap("map", "scale", run_folder, "--height", "0.60", "-o", tmp_path / "scaled")
    assert done.returncode == 0, done.stderr
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
    assert trajectory is not None
    assert (trajectory.poses[10].x_m, trajectory.poses[10].yaw_rad) == (pytest.approx(0.8), pytest.approx(0.3))
    grid = load_grid(tmp_path / "scaled")
    assert grid is not None
    assert grid.cell_m == 0.05
    assert grid.at([(0.02, 0.02), (1.57, 0.77), (1.62, 0.4)]).tolist() == [FREE, FREE, OCCUPIED]
    assert grid.area_m2(FREE) == pytest.approx(0.64 * floor().area_m2(FREE), rel=0.05)


def test_a_distance_between_two_objects_scales_it_too(edgemap, run_folder, tmp_path):
    length_m = 1.5 * math.hypot(2.0, 2.0)
    between = ("--between", f"chair-1,couch-1,{length_m}")
    done = edgemap("map", "scale", run_folder / "map.json", *between, "-o", tmp_path / "scaled")
    assert done.returncode == 0, done.stderr
    objects, _ = load_annotated_map(tmp_path / "scaled")
    assert math.dist(objects[0].position_m, objects[1].position_m) == pytest.approx(length_m)
    grid = load_grid(tmp_path / "scaled")
    assert grid is not None
    assert grid.area_m2(FREE) == pytest.approx(2.25 * floor().area_m2(FREE), rel=0.05)  # without holes
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
def test_what_is_no_scale_is_one_line(edgemap, run_folder, tmp_path, change, text):
    record = json.loads((run_folder / "run.json").read_text()) | change
    (run_folder / "run.json").write_text(json.dumps(record))
    assert text in one_line(edgemap("map", "scale", run_folder, "--height", "0.6", "-o", tmp_path / "scaled"), 2)
    assert not (tmp_path / "scaled").exists()


@pytest.mark.parametrize("height", ["1" + "0" * 400, "[]", "null", '"x"'])
def test_a_damaged_run_json_is_one_line(edgemap, run_folder, tmp_path, height):
    record = run_folder / "run.json"
    record.write_text(record.read_text().replace("0.75", height))
    done = edgemap("map", "scale", run_folder, "--height", "0.6", "-o", tmp_path / "scaled")
    assert "run.json: it has no mount" in one_line(done)


@pytest.mark.parametrize("factor", [0.5, 0.77, 1.0, 1.3, 2.0])
def test_a_grid_of_any_origin_keeps_its_places(factor):
    """Each state of the scaled grid is that of the old one at the point that lands there."""
    rng = np.random.default_rng(3)
    old = OccupancyGrid(rng.integers(-60, 60, (30, 50)).astype(np.int8), -1.35, 0.6, 0.05)
    new = old.scaled(factor)
    rows, columns = new.log_odds.shape
    centres = new.centres_m(np.ones((rows, columns), np.bool_)) / factor
    at = np.floor((centres - [old.x_m, old.y_m]) / 0.05 + 1e-9).astype(int)
    inside = ((at >= 0) & (at < [50, 30])).all(axis=1)
    assert inside.mean() > 0.9
    assert (new.log_odds.ravel()[inside] == old.log_odds[at[inside, 1], at[inside, 0]]).mean() > 0.99
    assert new.x_m / 0.05 == pytest.approx(round(new.x_m / 0.05))
