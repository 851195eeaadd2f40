import json

import numpy as np
import pytest
from support.drives import drive, exact, round_trip
from support.rooms import furnished, mapped
from support.tum import read_tum

from edgemap.geometry.camera.floor import FloorCamera
from edgemap.geometry.camera.intrinsics import Intrinsics
from edgemap.geometry.camera.mount import Mount
from edgemap.geometry.errors import MapError
from edgemap.geometry.objects.floor_map import FloorMap
from edgemap.geometry.se2 import SE2
from edgemap.runtime.outputs.sinks.run_folder import RunFolder
from edgemap.runtime.step.map_file import load_map, map_document
from edgemap.runtime.step.mapper import Mapper

ROOM = furnished(np.random.default_rng(11), 16, apart_m=0.8)
FLOOR = FloorCamera(Intrinsics(64, 64, 50.0, 50.0, 31.5, 31.5), Mount(1.0))


def go(mapper, start_rad=0.0, seed=1, room=None):
    """Results and maps of a round through the room, from an exact odometry."""
    poses = round_trip(80, start_rad=start_rad)
    return drive(mapper, room or ROOM, poses, exact(poses), seed)


def first_drive():
    *_, (_, objects) = go(Mapper(), seed=7)
    return objects


def in_room(objects, origin):
    """Label and rounded true place of each object's nearest thing, given the true pose of the map's origin."""
    found = {}
    for item in objects:
        place = origin.apply(item.position_m)
        near = min((np.hypot(place[0] - x, place[1] - y), (label, x, y)) for label, x, y in ROOM if label == item.label)
        assert near[0] < 0.25
        found[item.id] = near[1]
    return found


def test_a_saved_map_without_new_sightings_stays_as_it_is():
    saved = first_drive()
    again = FloorMap.continued(saved)
    for _ in range(700):  # more than what is forgotten after
        again.update([])
    assert map_document(again.objects()) == map_document(saved)


def test_a_known_start_goes_on_with_the_ids(tmp_path):
    saved, start = first_drive(), round_trip(80)[0]
    known = in_room(saved, start)
    there = round_trip(80, start_rad=2.0)[0]
    mapper = Mapper()
    mapper.start_in(saved, start.inverse() @ there)
    *_, (result, objects) = go(mapper, start_rad=2.0)
    now = in_room(objects, start)
    assert {identity: now[identity] for identity in known} == known
    assert len(set(now.values())) == len(now)  # nothing twice
    counts = {item.id: item.count for item in saved}
    assert all(item.count > counts[item.id] for item in objects if item.id in counts)
    assert result.relocated is None


def test_an_unknown_start_is_found_by_the_objects(tmp_path):
    saved, start = first_drive(), round_trip(80)[0]
    known = in_room(saved, start)
    way = round_trip(80, start_rad=2.0)
    mapper = Mapper()
    mapper.relocalise_in(saved)
    folder = RunFolder(tmp_path / "run", FLOOR, {})
    moved = []
    for index, (result, objects) in enumerate(go(mapper, start_rad=2.0)):
        folder.write(result, objects)
        moved += [index] if result.relocated else []
        if moved:
            at, truth = result.pose_map_base, start.inverse() @ way[index]
            assert np.hypot(at.x_m - truth.x_m, at.y_m - truth.y_m) < 0.15
            for placed, identity in zip(result.sightings, result.object_ids, strict=True):
                if identity in known:
                    there = start.apply(placed.position_map_m)
                    assert np.hypot(*(there - known[identity][1:])) < 0.4
    folder.close()
    assert len(moved) == 1
    assert 3 < moved[0] < 70
    now = in_room(mapper.objects(), start)
    assert {identity: now[identity] for identity in known} == known
    assert len(set(now.values())) == len(now)
    # What was written before the place was known is in the saved map's frame too.
    written = read_tum(tmp_path / "run" / "trajectory.tum")
    assert len(written.poses) == 80
    for pose, true in zip(written.poses, way, strict=True):
        assert start.inverse().apply([true.x_m, true.y_m]) == pytest.approx([pose.x_m, pose.y_m], abs=0.15)
    record = json.loads((tmp_path / "run" / "run.json").read_text())
    assert record["relocated"]["frame"] == moved[0] + 1
    merged, places = record["merged"], {item.id: item.position_m for item in load_map(tmp_path / "run")}
    for line in (tmp_path / "run" / "sightings.jsonl").read_text().splitlines():
        sighting = json.loads(line)
        identity = merged.get(sighting["object"], sighting["object"])
        if identity in places:
            assert np.linalg.norm(places[identity] - sighting["map_m"]) < 0.4


def test_an_id_means_one_thing_before_and_after():
    saved = first_drive()
    mapper = Mapper()
    mapper.relocalise_in(saved)
    assert mapper.relocaliser is not None
    taken, own = {item.id for item in saved}, set()
    for result, _ in go(mapper, start_rad=2.0):
        if mapper.relocaliser.alignment is None:
            own |= set(result.object_ids)
    assert not own & taken
    assert {new for old, new in result.merged.items() if old in own} & taken


def test_another_room_is_not_taken_for_the_saved_one():
    other = furnished(np.random.default_rng(12), 16, apart_m=0.8)
    mapper = Mapper()
    mapper.relocalise_in(first_drive())
    assert mapper.relocaliser is not None
    for result, _ in go(mapper, room=other):
        assert result.relocated is None
    assert mapper.relocaliser.alignment is None
    assert "objects with a common label" in mapper.relocaliser.reason
    assert len(mapper.objects()) > 5


def test_saved_chairs_side_by_side_stay_two():
    saved = mapped([("chair", 2.0, 0.0), ("chair", 2.3, 0.0)])
    mapper = Mapper()
    mapper.start_in(saved, SE2())
    still = [SE2()] * 30
    *_, (_, objects) = drive(mapper, [("chair", 2.0, 0.0), ("chair", 2.3, 0.0)], still, exact(still))
    assert [item.id for item in objects] == ["chair-1", "chair-2"]


def test_ids_given_twice_are_refused():
    saved = mapped([("chair", 2.0, 0.0)])
    with pytest.raises(MapError, match="2 objects share 1 ids"):
        FloorMap.continued(saved + saved)
