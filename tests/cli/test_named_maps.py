"""`--map auto`: which of the named maps the robot is in, or that none is known."""

import numpy as np
import pytest
from support.drives import drive, exact, round_trip
from support.rooms import furnished

from edgemap.cli.named_maps import FoundMap, find_place
from edgemap.geometry.errors import MapError
from edgemap.geometry.objects.annotations import Annotations, Zone
from edgemap.geometry.objects.events import Edit
from edgemap.runtime.outputs.verdict.verdict import Verdict
from edgemap.runtime.step.map_file import load_annotated_map, save_map
from edgemap.runtime.step.mapper import Mapper

ROOMS = {name: furnished(np.random.default_rng(seed), 16, apart_m=0.8) for name, seed in (("home", 11), ("office", 12))}
ZONE = Zone("zone-1", "corner", ((0.0, 0.0), (1.0, 0.0), (1.0, 1.0)))


def go(mapper, room, start_rad=0.0):
    poses = round_trip(80, start_rad=start_rad)
    return drive(mapper, room, poses, exact(poses), 7)


@pytest.fixture
def maps(tmp_path, monkeypatch):
    """Named maps of both rooms, one with a named chair and a zone."""
    monkeypatch.setenv("EDGEMAP_DATA", str(tmp_path))
    for name, room in ROOMS.items():
        mapper = Mapper()
        *_, (result, objects) = go(mapper, room)
        mapper.edit(Edit("name", objects[0].id, name="mine"))
        identity = result.annotations.identity
        (tmp_path / "maps" / name).mkdir(parents=True)
        save_map(tmp_path / "maps" / name / "map.json", mapper.objects(), Annotations((ZONE,), identity=identity))
    return tmp_path / "maps"


def test_the_place_is_the_map_that_fits_and_is_continued_with_its_names_and_zones(maps):
    before = {one.id: one for one in load_annotated_map(maps / "office")[0]}
    mapper = Mapper()
    finder = find_place(mapper)
    sink = FoundMap(lambda: finder.path, lambda: Verdict("good"))
    for result, objects in go(mapper, ROOMS["office"], start_rad=2.0):
        sink.write(result, objects)
    sink.close()
    sink.release()
    assert finder.path == maps / "office"
    now = {one.id: one for one in mapper.objects()}
    assert [now[one].name for one in before if before[one].name] == ["mine"]
    assert all(np.hypot(*(now[one].position_m - before[one].position_m)) < 0.3 for one in before)
    assert [zone.name for zone in mapper.annotations().zones] == ["corner"]
    saved, annotations = load_annotated_map(maps / "office")
    assert sum(one.count for one in saved) > sum(one.count for one in before.values())
    assert annotations.identity is not None
    assert annotations.identity.generation == 2


def test_a_place_that_no_map_is_of_stays_unknown_and_no_map_changes(maps):
    texts = {path: path.read_bytes() for path in maps.glob("*/map.json")}
    mapper = Mapper()
    finder = find_place(mapper)
    sink = FoundMap(lambda: finder.path, lambda: Verdict("good"))
    for result, objects in go(mapper, furnished(np.random.default_rng(13), 16, apart_m=0.8)):
        sink.write(result, objects)
    assert (finder.path, finder.searching) == (None, True)
    assert {path: path.read_bytes() for path in maps.glob("*/map.json")} == texts


def test_two_maps_of_one_place_are_no_answer(maps):
    (maps / "copy").mkdir()
    (maps / "copy" / "map.json").write_bytes((maps / "home" / "map.json").read_bytes())
    mapper = Mapper()
    finder = find_place(mapper)
    list(go(mapper, ROOMS["home"], start_rad=2.0))
    assert finder.path is None
    assert "copy and home both fit" in finder.reason


def test_without_a_named_map_there_is_nothing_to_find(tmp_path, monkeypatch):
    monkeypatch.setenv("EDGEMAP_DATA", str(tmp_path))
    with pytest.raises(MapError, match="no named map"):
        find_place(Mapper())
