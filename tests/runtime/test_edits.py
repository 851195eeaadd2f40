"""Edits of a map: laid over what was measured, kept by later runs, recorded and taken again."""

import errno
import json
import os
from dataclasses import replace

import numpy as np
import pytest
from support.drives import drive, exact, observed, round_trip, sighted
from support.faults import texts
from support.rooms import ROOM
from support.seen import CAMERA

from edgemap.geometry.errors import MapError
from edgemap.geometry.objects.annotations import Annotations, Zone
from edgemap.geometry.objects.events import Edit, EditError
from edgemap.geometry.objects.forgetting import Forgetter
from edgemap.geometry.observations.detections import Detections
from edgemap.geometry.se2 import SE2
from edgemap.geometry.trajectory_correction import TrajectoryCorrection
from edgemap.runtime.frames.errors import DiskError
from edgemap.runtime.step.edit_queue import Edits, load_edits
from edgemap.runtime.step.map_file import load_annotated_map, map_document, save_map
from edgemap.runtime.step.mapper import Mapper
from edgemap.runtime.step.relocalisation import SavedMap

POSES = round_trip(80)
SQUARE = ((0.0, 0.0), (2.0, 0.0), (2.0, 1.0), (0.0, 1.0))


def driven(mapper=None, poses=POSES, **options):
    """A mapper after a round through the room."""
    mapper = mapper or Mapper()
    for _ in drive(mapper, ROOM, poses, exact(poses), **options):
        pass
    return mapper


def ids(mapper):
    return [item.id for item in mapper.objects()]


def test_edits_change_neither_pose_nor_measured_map():
    plain, edited = driven(), Mapper()
    results = list(drive(edited, ROOM, POSES[:40], exact(POSES)[:40]))
    first = results[-1][1][0].id
    for edit in (
        Edit("name", first, name="mine"), Edit("confirm", first), Edit("delete", results[-1][1][1].id),
        Edit("zone", name="hall", corners_m=SQUARE),
    ):  # fmt: skip
        edited.edit(edit)
    random = np.random.default_rng(0)
    for index in range(40):  # the random numbers of the first half
        sighted(ROOM, POSES[index], index, random)
    for index in range(40, 80):
        edited.step(observed(index, sighted(ROOM, POSES[index], index, random), exact(POSES)[index]))
    assert map_document(edited.map.objects()) == map_document(plain.map.objects())
    assert edited.pose_map_base == plain.pose_map_base
    assert len(edited.objects()) == len(plain.objects()) - 1


def test_two_objects_that_a_person_merges_are_one_from_then_on():
    mapper = driven()
    ours, theirs = [item for item in mapper.objects() if item.label == "chair"][:2]
    mapper.edit(Edit("name", theirs.id, name="the chair"))
    mapper.edit(Edit("merge", theirs.id, into=ours.id))
    one = next(item for item in mapper.objects() if item.id == ours.id)
    assert (one.count, one.name) == (ours.count + theirs.count, "the chair")
    assert min(np.linalg.eigvalsh(one.covariance_m2)) > 0
    apart_m = np.linalg.norm(ours.position_m - theirs.position_m)
    assert np.sqrt(np.linalg.eigvalsh(one.covariance_m2)[-1]) > apart_m / 4  # as unsure as they differ
    assert theirs.id not in ids(mapper)
    update = mapper.step(observed(80, sighted(ROOM, POSES[0], 80, np.random.default_rng(1)), exact(POSES)[0]))
    assert update.merged[theirs.id] == ours.id
    assert theirs.id not in update.object_ids
    mapper.edit(Edit("delete", ours.id))  # both go, and both come back
    assert not {ours.id, theirs.id} & set(ids(mapper))
    mapper.edit(Edit("undo", ours.id))
    mapper.edit(Edit("undo", theirs.id))
    assert {ours.id, theirs.id} <= set(ids(mapper))


def test_a_confirmed_or_named_object_is_not_forgotten():
    """The chair is gone and in plain view, look after look: unconfirmed and without a name it leaves the map."""
    left = {}
    for edit in (None, Edit("confirm", "chair-1"), Edit("name", "chair-1", name="mine")):
        mapper = Mapper(forgetter=Forgetter(CAMERA))
        random = np.random.default_rng(0)
        for index in range(20):
            mapper.step(observed(index, sighted([("chair", 2.0, 0.0)], SE2(), index, random), exact([SE2()])[0]))
        if edit:
            mapper.edit(edit)
        place, nothing = SE2(), Detections.none(("chair",))
        for index in range(20, 120):
            there = SE2(0.3 + 0.2 * (index % 2), 0.0, 0.0)
            mapper.step(observed(index, [], replace(exact([SE2()])[0], motion=place.inverse() @ there), nothing))
            place = there
        left[edit and edit.do] = [(item.id, item.history[-1].what) for item in mapper.objects()]
    assert left == {None: [], "confirm": [("chair-1", "missed")], "name": [("chair-1", "missed")]}


def test_what_was_edited_is_kept_by_the_map_and_by_later_runs(tmp_path):
    """Saved, loaded, gone on with from a known start and from one that has to be found; then seen again and saved."""
    mapper = driven(seed=7)
    named, sure, gone, *_ = ids(mapper)
    mapper.edit(Edit("name", named, name="Ünser <b>Stuhl</b>"))
    mapper.edit(Edit("confirm", sure))
    mapper.edit(Edit("delete", gone))
    assert mapper.edit(Edit("zone", name="hall", corners_m=SQUARE)) == "zone-1"
    save_map(tmp_path / "map.json", mapper.objects(), mapper.annotations())
    objects, annotations = load_annotated_map(tmp_path)
    assert json.loads((tmp_path / "map.json").read_text())["format"] == "edgemap.map/1"
    known, lost = Mapper(), Mapper()
    known.start_in(SavedMap(objects, annotations), SE2())
    lost.relocalise_in(SavedMap(objects, annotations))
    assert lost.annotations().zones == ()  # it does not know yet where they are
    start = round_trip(80, start_rad=2.0)
    pose = POSES[0].inverse() @ start[0]
    known.pose_map_base = pose
    for later in (known, lost):
        driven(later, start, seed=3)
        found = {item.id: item for item in later.objects()}
        assert found[named].name == "Ünser <b>Stuhl</b>"
        assert (found[sure].confirmed, found[sure].confidence) == (True, 1.0)
        assert gone not in found
        assert [item.id for item in later.annotations().deleted] == [gone]
        (zone,) = later.annotations().zones
        assert (zone.id, zone.name) == ("zone-1", "hall")
        np.testing.assert_allclose(zone.corners_m, SQUARE, atol=1e-4)
        assert later.edit(Edit("zone", name="new", corners_m=SQUARE)) == "zone-2"
    assert lost.relocaliser.alignment is not None


def test_what_was_placed_by_hand_moves_with_the_part_of_the_path_near_it():
    """The end of a straight drive turns out to be 1 m to the left; what is there moves with it."""
    mapper, poses = Mapper(), [SE2(0.1 * k, 0.0, 0.0) for k in range(101)]
    for index, motion in enumerate(exact(poses)):
        mapper.step(observed(index, [], motion))
    mapper.edit(Edit("zone", name="start", corners_m=SQUARE))
    far = tuple((x + 9.0, y) for x, y in SQUARE)
    mapper.edit(Edit("zone", name="end", corners_m=far))
    mapper.edit(Edit("dock", pose=(9.0, 1.0, 0.0)))
    mapper.edit(Edit("add", label="tv", place_m=(9.0, 1.5)))
    times, moves = np.array([0.0, 5.0]), np.array([[0.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    mapper.edits.moved(TrajectoryCorrection(times, moves))
    start, end = mapper.annotations().zones
    np.testing.assert_allclose(start.corners_m, SQUARE)
    np.testing.assert_allclose(end.corners_m, [(x, y + 1.0) for x, y in far])
    assert mapper.annotations().dock == SE2(9.0, 2.0, 0.0)
    (tv,) = mapper.objects()
    assert tv.position_m == pytest.approx([9.0, 2.5])


def test_recorded_edits_make_the_same_map_again_and_a_replay_without_them_the_measured_one(tmp_path):
    def run(edits, asked=()):
        mapper, random = Mapper(), np.random.default_rng(0)
        for index, motion in enumerate(exact(POSES)):
            for number, edit in asked:
                if number == index:
                    edits.submit(edit)
            assert edits.apply(mapper, index) == []
            mapper.step(observed(index, sighted(ROOM, POSES[index], index, random), motion))
        return map_document(mapper.objects(), mapper.annotations()) | {"map_id": ""}

    plain = run(Edits())
    first = driven().objects()[0].id
    asked = [
        (50, Edit("name", first, name="Zoë's")), (50, Edit("confirm", first)),
        (60, Edit("zone", name="hall", corners_m=SQUARE)), (70, Edit("confirm", first, on=False)),
        (72, Edit("correct", first, label="bench", place_m=(1.0, 2.0), size_m=(1.2, 0.4, 0.8), yaw_rad=0.5)),
        (72, Edit("add", label="tv", place_m=(2.0, 0.5))), (73, Edit("dock", pose=(0.5, 0.5, 1.0))),
        (74, Edit("delete", first)), (74, Edit("undo", first)), (75, Edit("delete", "no such object")),
    ]  # fmt: skip
    edited = run(Edits(tmp_path / "edits.jsonl"), asked)
    assert edited != plain
    recorded = load_edits(tmp_path / "edits.jsonl")
    assert recorded == asked[:-1]  # what was refused is no edit
    assert run(Edits(recorded=recorded)) == edited
    assert run(Edits()) == plain


def test_a_recorded_edit_that_does_not_fit_is_told():
    edits = Edits(recorded=[(0, Edit("delete", "chair-1"))])
    assert texts(edits.apply(Mapper(), 0)) == "recorded edit delete 'chair-1': no object 'chair-1' on the map"


EDITS = ['{"frames":1,"do":"format"}', '{"frames":-1,"do":"delete"}', '{"frames":1,"do":"delete","x":1}']


@pytest.mark.parametrize("line", ["[]", "{}", "no", *EDITS])
def test_a_damaged_file_of_edits_is_one_line(tmp_path, line):
    path = tmp_path / "edits.jsonl"
    path.write_text(line + "\n")
    with pytest.raises(EditError, match=r"edits.jsonl:1") as raised:
        load_edits(path)
    assert "\n" not in str(raised.value)


def test_a_map_with_damaged_annotations_is_refused(tmp_path):
    zone = Zone("zone-1", "hall", SQUARE)
    good = map_document(driven().objects()[:2], Annotations((zone,)))
    wrong = [
        {"zones": [good["zones"][0] | {"corners_m": SQUARE[:2]}]}, {"zones": [good["zones"][0] | {"name": "x" * 81}]},
        {"zones": [good["zones"][0]] * 2}, {"zones": 3}, {"deleted": [{}]}, {"deleted": good["objects"][:1]},
        {"objects": [good["objects"][0] | {"name": 3}]}, {"objects": [good["objects"][0] | {"name": "a\u202eb"}]},
    ]  # fmt: skip
    for change in wrong:
        (tmp_path / "map.json").write_text(json.dumps(good | change))
        with pytest.raises(MapError, match=r"map\.json"):
            load_annotated_map(tmp_path)
    (tmp_path / "map.json").write_text(json.dumps(good | {"something": "new"}))
    assert load_annotated_map(tmp_path)[1] == Annotations((zone,))


def test_a_listener_that_fails_is_told_and_the_others_hear_of_the_edit():
    def gone(*_):
        raise RuntimeError("Event loop is closed")

    edits, heard = Edits(), []
    edits.listeners += [gone, lambda _, annotations: heard.append(annotations.zones[0].name)]
    asked = edits.submit(Edit("zone", name="hall", corners_m=SQUARE))
    assert texts(edits.apply(Mapper(), 0)) == "edited map: RuntimeError: Event loop is closed"
    assert heard == ["hall"]
    assert asked.result(0)


def test_an_edit_is_answered_when_it_is_on_disk_and_a_full_disk_gets_it_at_the_end(tmp_path, monkeypatch):
    mapper, edits, full = Mapper(), Edits(tmp_path / "edits.jsonl"), [True]
    edits.listeners.append(lambda *written: save_map(tmp_path / "map.json", *written))

    def unless_full(call):
        def written(*arguments):
            if full[0]:
                raise OSError(errno.ENOSPC, "No space left on device")
            return call(*arguments)

        return written

    for name in ("write", "fsync"):
        monkeypatch.setattr(f"edgemap.runtime.frames.disk.os.{name}", unless_full(getattr(os, name)))
    asked = edits.submit(Edit("zone", name="hall", corners_m=SQUARE))
    assert "No space left" in texts(edits.apply(mapper, 0))
    with pytest.raises(DiskError, match="No space left"):
        edits.close(mapper)
    full[0] = False
    edits.close(mapper)
    assert [zone.id for zone in load_annotated_map(tmp_path)[1].zones] == [asked.result(0)]
    assert [edit.name for _, edit in load_edits(tmp_path / "edits.jsonl")] == ["hall"]
