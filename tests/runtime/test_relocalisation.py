import json
from dataclasses import replace

import numpy as np
import pytest
from support.drives import drive, exact, round_trip
from support.painted import FLOOR
from support.rooms import ROOM, furnished, mapped

from edgemap.geometry.errors import MapError
from edgemap.geometry.objects.annotations import Annotations
from edgemap.geometry.objects.events import Edit, EditError
from edgemap.geometry.objects.floor_map import FloorMap
from edgemap.geometry.registration.alignment import AlignmentError, Registration
from edgemap.geometry.se2 import SE2
from edgemap.runtime.frames.trajectory import trajectory_of
from edgemap.runtime.outputs.sinks.run_folder import RunFolder
from edgemap.runtime.step.edit_queue import Edits
from edgemap.runtime.step.map_file import load_map, map_document, save_map
from edgemap.runtime.step.mapper import Mapper
from edgemap.runtime.step.relocalisation import SavedMap


def go(mapper, start_rad=0.0, seed=1, room=ROOM, count=80):
    """Results and maps of a round through the room, from an exact odometry."""
    poses = round_trip(80, start_rad=start_rad)[:count]
    return drive(mapper, room, poses, exact(poses), seed)


def driven(*arguments, **options):
    return list(go(*arguments, **options))


START, LATER = round_trip(80)[0], round_trip(80, start_rad=2.0)  # of the saved map's drive, and a later one
THERE, END = START.inverse() @ LATER[0], START.inverse() @ LATER[-1]  # of the later one in the saved map


@pytest.fixture(scope="module")
def saved():
    *_, (_, objects) = driven(Mapper(), seed=7)
    return objects


def off_m(pose, true):
    return np.hypot(pose.x_m - true.x_m, pose.y_m - true.y_m)


def in_room(objects, origin):
    """Label and rounded true place of each object's nearest thing, given the true pose of the map's origin."""
    found = {}
    for item in objects:
        place = origin.apply(item.position_m)
        near = min((np.hypot(place[0] - x, place[1] - y), (label, x, y)) for label, x, y in ROOM if label == item.label)
        assert near[0] < 0.25
        found[item.id] = near[1]
    return found


def test_a_saved_map_without_new_sightings_stays_as_it_is(saved):
    again = FloorMap().continued(saved)
    for _ in range(700):  # more than what is forgotten after
        again.update([])
    assert map_document(again.objects()) == map_document(saved)


def test_an_unknown_start_is_found_by_the_objects(saved, tmp_path):
    known, mapper = in_room(saved, START), Mapper()
    mapper.relocalise_in(SavedMap(saved))
    folder = RunFolder(tmp_path / "run", FLOOR, {})
    moved = []
    for index, (result, objects) in enumerate(go(mapper, start_rad=2.0)):
        folder.write(result, objects)
        moved += [index] if result.relocated else []
        if moved:
            assert off_m(result.pose_map_base, START.inverse() @ LATER[index]) < 0.15
            for placed, identity in zip(result.sightings, result.object_ids, strict=True):
                if identity in known:
                    there = START.apply(placed.position_map_m)
                    assert np.hypot(*(there - known[identity][1:])) < 0.4
    folder.close()
    assert len(moved) == 1
    assert 3 < moved[0] < 70
    now = in_room(mapper.objects(), START)
    assert {identity: now[identity] for identity in known} == known
    assert len(set(now.values())) == len(now)
    # What was written before the place was known is in the saved map's frame too.
    written = trajectory_of(tmp_path / "run" / "trajectory.tum")
    assert len(written.poses) == 80
    for pose, true in zip(written.poses, LATER, strict=True):
        assert START.inverse().apply([true.x_m, true.y_m]) == pytest.approx([pose.x_m, pose.y_m], abs=0.15)
    record = json.loads((tmp_path / "run" / "run.json").read_text())
    assert record["relocated"]["frame"] == moved[0] + 1
    merged, places = record["merged"], {item.id: item.position_m for item in load_map(tmp_path / "run")}
    for line in (tmp_path / "run" / "sightings.jsonl").read_text().splitlines():
        sighting = json.loads(line)
        identity = merged.get(sighting["object"], sighting["object"])
        if identity in places:
            assert np.linalg.norm(places[identity] - sighting["map_m"]) < 0.4


def test_an_id_means_one_thing_before_and_after(saved):
    mapper = Mapper()
    mapper.relocalise_in(SavedMap(saved))
    taken, own = {item.id for item in saved}, set()
    for result, _ in go(mapper, start_rad=2.0):
        if mapper.relocaliser.alignment is None:
            own |= set(result.object_ids)
    assert not own & taken
    assert {new for old, new in result.merged.items() if old in own} & taken


def test_another_room_is_not_taken_for_the_saved_one(saved):
    other = furnished(np.random.default_rng(12), 16, apart_m=0.8)
    mapper = Mapper()
    mapper.relocalise_in(SavedMap(saved))
    for result, _ in go(mapper, room=other):
        assert result.relocated is None
    assert mapper.relocaliser.alignment is None
    assert "objects with a common label" in mapper.relocaliser.reason
    assert len(mapper.objects()) > 5


def test_saved_chairs_side_by_side_stay_two():
    saved = mapped([("chair", 2.0, 0.0), ("chair", 2.3, 0.0)])
    mapper = Mapper()
    mapper.start_in(SavedMap(saved), SE2())
    still = [SE2()] * 30
    *_, (_, objects) = drive(mapper, [("chair", 2.0, 0.0), ("chair", 2.3, 0.0)], still, exact(still))
    assert [item.id for item in objects] == ["chair-1", "chair-2"]


def test_ids_given_twice_are_refused():
    saved = mapped([("chair", 2.0, 0.0)])
    with pytest.raises(MapError, match="2 objects share 1 ids"):
        FloorMap().continued(saved + saved)


def first_found(results):
    return next(index for index, (result, _) in enumerate(results) if result.relocated)


def test_a_right_guess_is_proved_sooner_than_a_search_finds_it(saved):
    searching, guessing = Mapper(), Mapper()
    searching.relocalise_in(SavedMap(saved))
    guessing.relocalise_in(SavedMap(saved), guesses=[SE2(30.0, 0.0, 0.0), THERE])
    searched, guessed = driven(searching, 2.0), driven(guessing, 2.0)
    assert first_found(guessed) < first_found(searched)
    assert off_m(guessed[-1][0].pose_map_base, END) < 0.3


def test_a_robot_that_was_carried_off_is_not_where_it_was_left(saved):
    """A wrong guess costs nothing: the objects refute it, and find the place as without it."""
    mapper = Mapper()
    mapper.relocalise_in(SavedMap(saved), guesses=[SE2(THERE.x_m + 2.0, THERE.y_m, THERE.yaw_rad + 1.5), SE2()])
    *_, (result, _) = driven(mapper, 2.0)
    assert off_m(result.pose_map_base, END) < 0.3


@pytest.mark.parametrize("at_last", [False, True])
def test_a_map_is_continued_at_its_last_pose_or_its_dock_whichever_is_right(saved, at_last):
    docked, found = Mapper(), Mapper()
    dock, last = (SE2(30.0, 0.0, 0.0), THERE) if at_last else (THERE, None)
    docked.continue_map(SavedMap(saved, Annotations(dock=dock, last_pose=last)))
    found.relocalise_in(SavedMap(saved), guesses=[THERE])
    assert first_found(driven(docked, 2.0)) == first_found(driven(found, 2.0))


@pytest.mark.parametrize("seed", range(5))
def test_chance_proves_no_guess(seed):
    """Rooms with nothing in common but their classes."""
    random = np.random.default_rng(seed)
    room, other = (mapped(furnished(random, 12, apart_m=0.8)) for _ in range(2))
    with pytest.raises(AlignmentError, match="no guessed start fits"):
        Registration(room, other[:4]).aligned_near([SE2(), SE2(1.0, 0.0, 0.5)])


@pytest.mark.parametrize("in_dock", [False, True])
def test_a_pose_that_is_set_ends_the_search(saved, in_dock):
    mapper = Mapper()
    mapper.relocalise_in(SavedMap(saved, Annotations(dock=THERE)))
    assert mapper.searching
    assert mapper.annotations().dock is None  # it is in a frame that the robot has yet to find
    pose = Edit("pose", "dock") if in_dock else Edit("pose", pose=(THERE.x_m, THERE.y_m, THERE.yaw_rad))
    assert mapper.edit(pose) == "pose"
    assert not mapper.searching
    assert mapper.annotations().dock == THERE
    results = driven(mapper, 2.0)
    assert first_found(results) == 0
    assert off_m(results[-1][0].pose_map_base, END) < 0.3
    assert len(results[-1][1]) <= len(saved) + 2  # nothing twice


def test_a_robot_that_was_lifted_and_set_down_goes_on_in_its_map():
    mapper = Mapper()
    before = driven(mapper, count=40)[-1][1]
    places = {item.id: item.position_m for item in before}
    mapper.edit(Edit("pose", pose=(1.0, 2.0, 0.5), sigmas=(0.2, 0.2, 0.1)))
    assert (mapper.pose_map_base.x_m, mapper.pose_map_base.y_m) == (1.0, 2.0)
    assert np.diag(mapper.pose_covariance) == pytest.approx([0.04, 0.04, 0.01])
    for item in mapper.objects():
        assert item.position_m == pytest.approx(places[item.id], abs=1e-6)


@pytest.mark.parametrize(
    "edit",
    [
        Edit("pose"), Edit("pose", pose=(np.nan, 0.0, 0.0)), Edit("pose", pose=(0.0, 0.0, np.inf)),
        Edit("pose", pose=(0.0, 0.0, 0.0), sigmas=(0.0, 1.0, 1.0)), Edit("dock"),
    ],
)  # fmt: skip
def test_what_is_no_pose_is_refused(edit):
    edits = Edits()
    asked = edits.submit(edit)
    edits.apply(Mapper(), 0)
    with pytest.raises(EditError):
        asked.result(0)


@pytest.mark.parametrize("far", [(1e6, 1e6, 0.0), (2e6, 0.0, 0.0), (0.0, -1e308, 0.0), (400.0, 0.0, 0.0)])
def test_a_pose_far_from_the_map_is_refused_and_loses_nothing(saved, far):
    mapper = Mapper()
    driven(mapper, count=40)
    before = mapper.pose_map_base, [item.id for item in mapper.objects()]
    for edit in (
        Edit("pose", pose=far), Edit("dock", pose=far), Edit("add", label="chair", place_m=far[:2]),
        Edit("correct", "chair-1", place_m=far[:2]),
        Edit("zone", name="far", corners_m=((0.0, 0.0), (0.0, 1.0), far[:2])),
    ):  # fmt: skip
        with pytest.raises(EditError, match="too far: the map would be more than 50 m wide"):
            mapper.edit(edit)
    assert (mapper.pose_map_base, [item.id for item in mapper.objects()]) == before
    with pytest.raises(MapError, match="too far: the map would be more than 50 m wide"):
        Mapper().start_in(SavedMap(saved), SE2(*far))
    with pytest.raises(MapError, match="its yaw is no number"):
        Mapper().start_in(SavedMap(saved), SE2(0.0, 0.0, np.inf))


@pytest.mark.parametrize("x_m", [1e6 + 1.0, float("nan"), float("inf")])
def test_a_map_that_no_reader_takes_does_not_replace_one_that_they_do(saved, x_m, tmp_path):
    save_map(tmp_path / "map.json", saved)
    bad = [replace(saved[0], position_m=np.array([x_m, 0.0])), *saved[1:]]
    with pytest.raises(MapError, match="not saved"):
        save_map(tmp_path / "map.json", bad)
    assert [item.id for item in load_map(tmp_path / "map.json")] == [item.id for item in saved]
