"""`map export` and `map merge` as a user calls them."""

import json
from dataclasses import replace

import numpy as np
import pytest
from support.refusal import one_line
from support.rooms import furnished, mapped

from edgemap.geometry.objects.annotations import Annotations, Zone
from edgemap.geometry.se2 import SE2
from edgemap.runtime.frames.trajectory import tum_line
from edgemap.runtime.step.map_file import load_annotated_map, save_map


@pytest.fixture
def run_folder(tmp_path):
    folder = tmp_path / "run"
    folder.mkdir()
    save_map(folder / "map.json", mapped([("chair", 1.0, 0.0), ("couch", 3.0, 2.0)]))
    (folder / "trajectory.tum").write_text("".join(tum_line(k / 10, SE2(k / 10, 0.0)) for k in range(20)))
    return folder


def test_every_format_lands_beside_the_map(edgemap, run_folder):
    expected = {
        "geojson": "map.geojson", "nav2": "map.yaml", "nav2-vector": "vector_objects.yaml", "csv": "map.csv",
        "svg": "map.svg",
    }  # fmt: skip
    for kind, name in expected.items():
        done = edgemap("map", "export", run_folder, "--format", kind)
        assert done.returncode == 0, done.stderr
        assert str(run_folder / name) in done.stdout
        assert (run_folder / name).stat().st_size > 0
    assert (run_folder / "map.pgm").read_bytes().startswith(b"P5\n")
    assert json.loads((run_folder / "map.geojson").read_text())["features"][-1]["id"] == "trajectory"


def test_export_into_a_file_and_into_a_folder(edgemap, run_folder, tmp_path):
    assert edgemap("map", "export", run_folder, "--format", "nav2", "-o", tmp_path / "a" / "flat.pgm").returncode == 0
    assert "image: flat.pgm" in (tmp_path / "a" / "flat.yaml").read_text()
    assert edgemap("map", "export", run_folder / "map.json", "--format", "csv", "-o", tmp_path / "b").returncode == 0
    assert (tmp_path / "b" / "map.csv").is_file()


def test_two_drives_of_one_room_become_one_map(edgemap, tmp_path):
    random = np.random.default_rng(3)
    room = furnished(random, 14)
    first, second = mapped(room[:12]), mapped(room[2:], SE2(4.0, -1.0, 2.5))
    first[0] = replace(first[0], name="mine", confirmed=True)
    zone = Zone("zone-1", "hall", ((0.0, 0.0), (1.0, 0.0), (1.0, 1.0)))
    save_map(tmp_path / "a.json", first, Annotations((zone,)))
    there = SE2(4.0, -1.0, 2.5).inverse().apply(np.array(zone.corners_m))
    save_map(tmp_path / "b.json", second, Annotations((replace(zone, corners_m=tuple(map(tuple, there.tolist()))),)))
    done = edgemap("map", "merge", tmp_path / "a.json", tmp_path / "b.json", "-o", tmp_path / "merged")
    assert done.returncode == 0, done.stderr
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


def test_maps_that_do_not_fit_are_refused_with_numbers(edgemap, tmp_path):
    save_map(tmp_path / "a.json", mapped([("chair", x, y) for x in (0.0, 2.0) for y in (0.0, 3.0)]))
    twice = edgemap("map", "merge", tmp_path / "a.json", tmp_path / "a.json", "-o", tmp_path / "m.json")
    assert "does not fit" in one_line(twice)
    assert not (tmp_path / "m.json").exists()
